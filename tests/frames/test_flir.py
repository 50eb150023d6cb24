"""Radiometric JPEGs: FLIR's counts are the frame, and whatever else makers put into segments leaves it an ordinary JPEG."""

from __future__ import annotations

import io
import math
import struct

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.decode import decode_image
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.frames.flir import Planck, planck_in
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.frames.temperature import PlanckUnit, likely_unit, units_told
from gcs_mosaic.messages import content_hash
from tests.frames.flir_writer import PLANCK, flir_file, numbered, radiometric
from tests.frames.image_files import encoded, textured
from tests.frames.jpeg_writer import segment

WIDTH, HEIGHT = 320, 256  # 160 kB of counts: three segments
JPEG = encoded(".jpg", textured(WIDTH, HEIGHT))
PICTURE = decode_image(JPEG)


def some_counts(seed: int = 4) -> np.ndarray:
    """Ground around 20 °C."""
    rng = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), 5)
    return np.rint(14_000 + 120 * soft / soft.std() + rng.normal(0, 4, soft.shape)).astype(np.uint16)


COUNTS = some_counts()
HOW = {"rows": {}, "rows, high byte first": {"order": ">"}, "PNG": {"png": True}}


@pytest.mark.parametrize("how", HOW)
def test_the_counts_are_the_frame(how: str) -> None:
    data = radiometric(JPEG, COUNTS, **HOW[how])  # type: ignore[arg-type]
    assert is_whole(data) == Whole(WIDTH, HEIGHT)
    np.testing.assert_array_equal(decode_image(data), COUNTS[..., None])
    half = decode_image(data, reduction=2)
    assert isinstance(half, np.ndarray)
    assert (half.shape, half.dtype) == ((HEIGHT // 2, WIDTH // 2, 1), np.uint16)
    assert np.abs(half[..., 0] - COUNTS.reshape(HEIGHT // 2, 2, WIDTH // 2, 2).mean(axis=(1, 3))).max() <= 1


@pytest.mark.long
def test_so_they_are_out_of_the_decoders_process() -> None:
    data, decoders = radiometric(JPEG, COUNTS), Decoders(processes=1)
    try:
        for _ in range(2):  # the second time it is known, and decoded without that process
            np.testing.assert_array_equal(decoders.decode(data, content_hash(data)), COUNTS[..., None])
        reduced = decoders.decode(data, content_hash(data), 4)
        assert isinstance(reduced, np.ndarray)
        assert reduced.shape == (HEIGHT // 4, WIDTH // 4, 1)
    finally:
        decoders.close()


def test_without_an_end_marker_missing_rows_are_still_found() -> None:
    """By the picture, which is decoded before its counts take its place."""
    data = radiometric(JPEG, COUNTS)
    np.testing.assert_array_equal(decode_image(data[:-2]), COUNTS[..., None])
    refused = decode_image(data[: -len(JPEG) // 2])
    assert "rows are missing" in getattr(refused, "reason", "")


def spoilt() -> dict[str, bytes]:
    """FLIR's segments with something amiss."""
    whole, block = numbered(flir_file(COUNTS)), bytearray(flir_file(COUNTS))
    record = 64 + 32 * 14

    def with_segments(*contents: bytes) -> bytes:
        return JPEG[:2] + b"".join(segment(0xE1, one) for one in contents) + JPEG[2:]

    def changed(at: int, to: bytes) -> bytes:
        return with_segments(*numbered(bytes(block[:at] + to + block[at + len(to) :])))

    png = flir_file(COUNTS, png=True)
    return {
        "a part is missing": radiometric(JPEG, COUNTS, parts=[0, 2]),
        "the first part is missing": radiometric(JPEG, COUNTS, parts=[1, 2]),
        "no record": changed(24, struct.pack(">II", 64, 0)),
        "records that lie nowhere": changed(24, struct.pack(">II", 2**31, 14)),
        "records without end": changed(28, struct.pack(">I", 2**32 - 1) + block[32:64] + bytes(32 * 14)),
        "a record that lies nowhere": changed(64 + 12, struct.pack(">I", 2**31)),
        "a record of no length": changed(64 + 16, bytes(4)),
        "another size": radiometric(JPEG, COUNTS[:128, :160]),
        "a size that is not there": changed(record + 2, struct.pack("<HH", WIDTH, 60_000)),
        "nothing but zeros": radiometric(JPEG, np.zeros_like(COUNTS)),
        "half a PNG": with_segments(*numbered(png[: len(png) // 2])),
        "a PNG of another size": with_segments(*numbered(png.replace(b"IHDR\0\0\1\x40", b"IHDR\0\1\1\x40"))),
        "not FLIR's file": with_segments(*numbered(b"GGG" + bytes(block[3:]))),
        "a segment with nothing in it": with_segments(b"FLIR\0"),
        "a segment of no number": with_segments(b"FLIR\0\1"),
        "a last number of 255": with_segments(whole[0][:7] + b"\xff" + whole[0][8:], *whole[1:]),
        "an ordinary JPEG": JPEG,
    }


@pytest.mark.parametrize("how", spoilt())
def test_whatever_is_amiss_the_picture_is_the_frame(how: str) -> None:
    data = spoilt()[how]
    assert is_whole(data) == Whole(WIDTH, HEIGHT)
    np.testing.assert_array_equal(decode_image(data), PICTURE)


def test_parts_in_another_order_or_twice_are_put_together() -> None:
    data = radiometric(JPEG, COUNTS, parts=[2, 0, 0, 1, 2])
    np.testing.assert_array_equal(decode_image(data), COUNTS[..., None])


def others() -> dict[str, bytes]:
    """Segments of other makers' radiometric JPEGs, and of files of several pictures."""
    raw = COUNTS.tobytes()
    thermal = b"".join(segment(0xE3, raw[at : at + 65_533]) for at in range(0, len(raw), 65_533))
    tables = segment(0xE4, bytes(range(256)) * 255) + segment(0xE5, b"\xff\xd8\xff\xe0" * 8000)
    index = b"MPF\0MM\0*\0\0\0\x08\0\x01\xb0\x01\0\x04\0\0\0\x01\0\0\0\x02\0\0\0\0"
    huge = b"".join(segment(0xE7, b"\xff\xda" + bytes([k]) * 65_000) for k in range(150))
    return {
        "counts and tables of DJI's": JPEG[:2] + thermal + tables + JPEG[2:],
        "several pictures (MPF)": JPEG[:2] + segment(0xE2, index) + JPEG[2:] + encoded(".jpg", textured(80, 60)),
        "10 MB of segments": JPEG[:2] + huge + JPEG[2:],
        "segments without content": JPEG[:2] + segment(0xE3) * 300 + JPEG[2:],
        "fill bytes": JPEG[:2] + b"\xff" * 40 + segment(0xE3, raw[:500]) + b"\xff" * 7 + JPEG[2:],
    }


@pytest.mark.parametrize("how", others())
def test_other_radiometric_jpegs_are_taken_as_pictures_at_once(how: str) -> None:
    data = others()[how]
    assert is_whole(data) == Whole(WIDTH, HEIGHT)
    np.testing.assert_array_equal(decode_image(data), PICTURE)


@pytest.mark.parametrize("how", [*others(), "counts of FLIR's"])
def test_while_segments_come_there_is_no_frame_yet(how: str) -> None:
    data = (others() | {"counts of FLIR's": radiometric(JPEG, COUNTS)})[how]
    begin = data.index(JPEG[2:30])
    for end in np.linspace(2, begin, 12).astype(int):
        assert isinstance(is_whole(data[:end]), NotWhole)
        assert not isinstance(decode_image(data[:end]), np.ndarray)
    half = is_whole(data[: begin + len(JPEG) // 2])
    assert getattr(half, "doubt", "refused")


def test_constants_tell_degrees() -> None:
    """As flyr 5.1.0 reads the same file, for a black body and no air."""
    file = io.BytesIO(radiometric(JPEG, COUNTS))
    told = planck_in(file)
    assert told is not None
    assert told.kelvin(3321) == pytest.approx(296.22696, abs=1e-4)
    (unit,) = units_told(file)
    assert unit == PlanckUnit(told)
    assert likely_unit((unit,), 14_000) is unit
    assert unit.step(14_000) == pytest.approx(unit.celsius(14_000.5) - unit.celsius(13_999.5), rel=1e-4)


def test_counts_of_no_temperature_have_none() -> None:
    unit = PlanckUnit(Planck(*PLANCK))
    for count in (0, 342, -5000):
        assert math.isnan(unit.celsius(count))
        assert likely_unit((unit,), count) is None


@pytest.mark.parametrize("how", ["the first part is missing", "no record", "not FLIR's file", "an ordinary JPEG"])
def test_who_tells_no_constants_tells_none(how: str) -> None:
    assert units_told(io.BytesIO(spoilt()[how])) == ()


def test_constants_that_are_no_numbers_are_none() -> None:
    data = radiometric(JPEG, COUNTS)
    told = struct.pack("<f", PLANCK[0])
    for wrong in (math.nan, math.inf, 0.0, -1.0):
        assert planck_in(io.BytesIO(data.replace(told, struct.pack("<f", wrong)))) is None
