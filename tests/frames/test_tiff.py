"""TIFFs that are whole whatever their tags say, and TIFFs with strips that are missing."""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
import pytest
import tifffile

from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.frames.tiff import first_page
from tests.frames.image_files import counts, many_bands


def of_tags(*more: tuple[int, int, int, bytes, bool]) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, counts(3)[..., ::-1], photometric="rgb", metadata=None, extratags=more)
    return file.getvalue()


def test_a_tiff_with_fields_behind_its_end_is_whole() -> None:
    """A maker's note whose offset is not of this file."""
    plain = of_tags()
    data = bytearray(of_tags((65000, 7, 8, b"maker note"[:8], True)))
    at = data.index(struct.pack("<HHI", 65000, 7, 8)) + 8
    data[at : at + 4] = struct.pack("<I", 1 << 30)
    assert getattr(is_whole(bytes(data)), "doubt", "").startswith("a field of it lies behind its end")
    np.testing.assert_array_equal(decode_image(bytes(data)), decode_image(plain))


def test_a_palette_that_has_not_come_yet_is_waited_for() -> None:
    """Some write it at the end; without it the picture has other colours."""
    file = io.BytesIO()
    colours = np.random.default_rng(1).integers(0, 65535, (3, 256), np.uint16)
    tifffile.imwrite(file, counts(1, np.uint8)[..., 0], photometric="palette", colormap=colours, metadata=None)
    data = file.getvalue()
    assert is_whole(data) == Whole(160, 120, 3)
    at = data.index(struct.pack("<HHI", 320, 3, 768)) + 8
    late = data[:at] + struct.pack("<I", len(data)) + data[at + 4 :]
    assert isinstance(is_whole(late + bytes(100)), NotWhole)
    np.testing.assert_array_equal(decode_image(late + colours.tobytes()), decode_image(data))


def test_a_second_page_that_is_not_there_does_no_harm() -> None:
    """The offset of the next directory leads nowhere."""
    data = bytearray(of_tags())
    (entries,) = struct.unpack_from("<H", data, 8)
    data[10 + 12 * entries : 14 + 12 * entries] = struct.pack("<I", len(data) + 999)
    assert getattr(is_whole(bytes(data)), "doubt", "")
    np.testing.assert_array_equal(decode_image(bytes(data)), decode_image(of_tags()))


def test_pages_and_bytes_behind_the_first_page_do_no_harm() -> None:
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as pages:
        pages.write(counts(3)[..., ::-1], photometric="rgb", metadata=None)
        pages.write(counts(3)[::4, ::4, ::-1], photometric="rgb", metadata=None, subfiletype=1)
    for data in (file.getvalue(), file.getvalue() + b"maker", file.getvalue()[:-500]):
        np.testing.assert_array_equal(decode_image(data), counts(3))


@pytest.mark.parametrize("orientation", [2, 3, 6, 8])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_an_orientation_turns_no_tiff(kind: type, orientation: int) -> None:
    """OpenCV turned them: a camera that was mounted upside down was refused, or its frames were another way round than its
    JPEGs."""
    data = many_bands(1, kind, extratags=[(274, 3, 1, orientation, True)])
    np.testing.assert_array_equal(decode_image(data), counts(1, kind))


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"tile": (64, 64)}])
@pytest.mark.parametrize("bands", [1, 5])
def test_a_tiff_without_some_of_its_strips_is_refused(bands: int, options: dict[str, Any]) -> None:
    data = many_bands(bands, **options)
    for share in (0.5, 0.8, 0.99):
        begun = data[: int(share * len(data))]
        assert getattr(is_whole(begun), "doubt", "refused")
        assert isinstance(decode_image(begun), Unreadable)


def test_compressed_strips_that_were_never_written_are_missing() -> None:
    """Room for the file was taken before it came; OpenCV paints such strips black."""
    data = many_bands(1, np.uint8, compression="zlib", rowsperstrip=8)
    begun = data[: len(data) // 2].ljust(len(data), b"\0")
    assert getattr(is_whole(begun), "doubt", "") == "it ends in zeros"
    assert "of the TIFF's strips were not written" in getattr(decode_image(begun), "reason", "")


def test_zeros_behind_a_compressed_strip_are_padding() -> None:
    """Some cameras give every strip the same room; where it ends is decided by what it unpacks to."""
    data = many_bands(1, np.uint8, compression="zlib", rowsperstrip=120)
    ((offset, count),) = first_page(data).pieces
    at = data.index(struct.pack("<HHII", 279, 4, 1, count))
    padded = data[: at + 8] + struct.pack("<I", count + 900) + data[at + 12 : offset + count] + bytes(900)
    assert getattr(is_whole(padded), "doubt", "") == "it ends in zeros"
    np.testing.assert_array_equal(decode_image(padded), counts(1, np.uint8))
    begun = data[: offset + count // 2].ljust(len(data), b"\0")
    assert decode_image(begun) == Unreadable("truncated: the TIFF's data end before the picture does")


@pytest.mark.parametrize(("number", "name"), [(34712, "JPEG 2000"), (50000, "Zstandard"), (12345, "number 12345")])
def test_a_compression_that_no_decoder_reads_is_named(number: int, name: str) -> None:
    """JPEG 2000 came back as a black picture."""
    plain = of_tags()
    data = plain.replace(struct.pack("<HHIHH", 259, 3, 1, 1, 0), struct.pack("<HHIHH", 259, 3, 1, number, 0))
    assert data != plain
    reason = f"a TIFF compressed by {name} is not read, save it without compression, or as Deflate or LZW"
    assert decode_image(data) == Unreadable(reason)
