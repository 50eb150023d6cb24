"""PNGs that are whole whatever lies around their data, and PNGs with rows that are missing."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.frames.integrity import is_whole
from tests.frames.image_files import encoded, textured

SMALL = textured(203, 150)
PNG = encoded(".png", SMALL)
KINDS_OF_PNG = {
    "colour": PNG,
    "grey of 16 bits": encoded(".png", textured(90, 60).astype(np.uint16)[..., 0] * 200),
    "transparent": encoded(".png", np.dstack([SMALL, SMALL[..., :1]])),
    "grey": encoded(".png", SMALL[..., 0]),
}


def chunk(kind: bytes, data: bytes, checksum: int | None = None) -> bytes:
    right = zlib.crc32(kind + data)
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", right if checksum is None else checksum)


@pytest.mark.parametrize("kind", KINDS_OF_PNG)
def test_a_png_without_its_end_or_with_a_wrong_text_is_whole(kind: str) -> None:
    png = KINDS_OF_PNG[kind]
    wrong = chunk(b"tEXt", b"Comment\0flight 7", checksum=1)
    for data in (png[:-12], png[:-14], png[:33] + wrong + png[33:], png[:-12] + wrong + png[-12:], b"\r\n" + png):
        assert getattr(is_whole(data), "doubt", "")
        np.testing.assert_array_equal(decode_image(data), decode_image(png))


def test_a_wrong_checksum_of_data_that_prove_right_by_their_own_is_no_damage() -> None:
    at = PNG.index(b"IDAT")
    (length,) = struct.unpack_from(">I", PNG, at - 4)
    data = PNG[: at + 4 + length] + b"\0\0\0\0" + PNG[at + 8 + length :]
    np.testing.assert_array_equal(decode_image(data), decode_image(PNG))


@pytest.mark.parametrize("padding", [b"", bytes(20_000)])
@pytest.mark.parametrize("kind", KINDS_OF_PNG)
def test_a_png_that_is_cut_anywhere_is_refused(kind: str, padding: bytes) -> None:
    png = KINDS_OF_PNG[kind]
    for end in np.random.default_rng(3).integers(1, len(png) - 40, 10):
        assert isinstance(decode_image(png[:end] + padding), Unreadable)


def test_rows_that_are_missing_of_a_png_are_told() -> None:
    assert getattr(decode_image(PNG[: len(PNG) // 2]), "reason", "").endswith("of 150 rows are missing")


def test_a_changed_byte_in_a_png_is_damage() -> None:
    changed = PNG[:-40] + bytes([PNG[-40] ^ 1]) + PNG[-39:]
    assert "wrong checksum" in getattr(decode_image(changed), "reason", "")
