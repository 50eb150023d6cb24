from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gcs_mosaic.frames.decode import Unreadable, decode_image, load_frame, load_image
from gcs_mosaic.frames.tiff import first_page
from gcs_mosaic.messages import Frame, content_hash
from tests.frames.image_files import counts, encoded, many_bands, picture, turned


def decoded(data: bytes, reduction: int = 1) -> NDArray[Any]:
    image = decode_image(data, reduction=reduction)
    assert isinstance(image, np.ndarray)
    return image


def difference(data: bytes, wanted: np.ndarray) -> float:
    image = decoded(data)
    assert (image.dtype, image.shape) == (np.dtype(np.uint8), wanted.shape)
    return float(np.abs(image.astype(int) - wanted).max())


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_pixels_come_back_as_they_were(suffix: str) -> None:
    assert difference(encoded(suffix), picture()) == 0


def test_a_jpeg_comes_back_nearly() -> None:
    assert difference(encoded(".jpg", None, cv2.IMWRITE_JPEG_QUALITY, 98), picture()) < 12


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_sixteen_bits_come_back_as_they_were(suffix: str) -> None:
    deep = picture(kind=np.uint16)
    np.testing.assert_array_equal(decode_image(encoded(suffix, deep)), deep)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_grey_stays_one_band(suffix: str, kind: type) -> None:
    grey = picture(kind=kind)[..., :1]
    image = decoded(encoded(suffix, grey))
    np.testing.assert_array_equal(image, grey)
    assert image.dtype == kind


def test_a_grey_jpeg_is_one_band_at_every_size() -> None:
    data = encoded(".jpg", picture()[..., 0])
    assert [decoded(data, reduction=by).shape for by in (1, 2, 4)] == [(120, 160, 1), (60, 80, 1), (30, 40, 1)]


def test_transparency_is_no_band() -> None:
    transparent = np.dstack([picture(), picture(seed=1)[..., :1]])
    np.testing.assert_array_equal(decode_image(encoded(".png", transparent)), picture())


DEFLATE: dict[str, Any] = {"compression": "zlib", "predictor": True}


@pytest.mark.parametrize("options", [{}, DEFLATE, {"tile": (64, 64)}, {"byteorder": ">"}, {"bigtiff": True}])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("bands", [2, 4, 5, 9])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_every_band_of_a_tiff_comes_back(bands: int, kind: type, planar: str, options: dict[str, Any]) -> None:
    image = decoded(many_bands(bands, kind, planarconfig=planar, **options))
    np.testing.assert_array_equal(image, counts(bands, kind))
    assert image.dtype == kind


def test_three_bands_one_after_another_are_a_picture_in_colour() -> None:
    np.testing.assert_array_equal(decode_image(many_bands(3, planarconfig="separate")), counts(3)[..., ::-1])


def test_a_transparent_band_among_others_is_left_out() -> None:
    image = decode_image(many_bands(6, extrasamples=[0, 2, 0, 0, 0]))
    np.testing.assert_array_equal(image, np.delete(counts(6), 2, axis=2))


def test_more_data_than_pixels_is_not_unpacked() -> None:
    """A strip that says it holds 5 kB and unpacks to a gigabyte."""
    data = many_bands(5, compression="zlib", rowsperstrip=120)
    page = first_page(data)
    bomb = zlib.compress(bytes(10_000_000), 9)
    ((offset, count),) = page.pieces
    assert len(bomb) < count
    refused = decode_image(data[:offset] + bomb.ljust(count, b"\0") + data[offset + count :])
    assert refused == Unreadable("damaged: a TIFF with more data than pixels")


def test_a_compression_that_is_not_read_is_named() -> None:
    data = many_bands(5)
    at = data.index(struct.pack("<HHIH", 259, 3, 1, 1))
    refused = decode_image(data[: at + 8] + struct.pack("<H", 5) + data[at + 10 :])
    assert refused == Unreadable("compression 5 is not read for 5 bands of 16 bits: save without, or as Deflate")


@given(st.lists(st.tuples(st.integers(0, 300), st.integers(0, 255)), max_size=8), st.integers(0, 3))
@settings(deadline=None)
def test_no_damage_to_a_tiff_of_many_bands_raises(changes: list[tuple[int, int]], which: int) -> None:
    damaged = bytearray(MANY[which])
    for place, value in changes:
        damaged[place] = value
    assert isinstance(decode_image(bytes(damaged), max_pixels=1_000_000), np.ndarray | Unreadable)


MANY = [many_bands(5), many_bands(5, **DEFLATE), many_bands(2, tile=(64, 64)), many_bands(4, planarconfig="separate")]


@pytest.mark.parametrize("by", [2, 4])
def test_a_reduced_picture_is_the_mean_of_squares(by: int) -> None:
    wide = counts(5)[:119, :157]
    file = io.BytesIO()
    tifffile.imwrite(file, wide, photometric="minisblack", planarconfig="contig")
    image = decoded(file.getvalue(), reduction=by)
    padded = np.pad(wide, ((0, -119 % by), (0, -157 % by), (0, 0)), mode="edge").astype(float)
    mean = padded.reshape(padded.shape[0] // by, by, padded.shape[1] // by, by, 5).mean(axis=(1, 3))
    assert image.dtype == np.uint16
    np.testing.assert_allclose(image, mean, atol=0.51)


def test_orientation_is_not_applied() -> None:
    image = decoded(turned(encoded(".jpg")))
    assert image.shape == (120, 160, 3)


def test_a_colour_profile_is_not_applied() -> None:
    """Pixels are compared with pixels of the same camera: their numbers must stay as they were taken."""
    jpeg = encoded(".jpg")
    profile = b"ICC_PROFILE\0\x01\x01" + bytes(range(256)) * 2
    with_profile = jpeg[:2] + b"\xff\xe2" + struct.pack(">H", 2 + len(profile)) + profile + jpeg[2:]
    assert np.array_equal(decoded(with_profile), decoded(jpeg))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_picture_is_never_half_grey(share: float) -> None:
    data = encoded(".jpg")
    assert isinstance(decode_image(data[: int(share * len(data))]), Unreadable)


def test_a_file_that_opencv_cannot_decode_is_unreadable() -> None:
    data = bytearray(encoded(".jpg"))
    data[data.index(b"\xff\xc0") + 9] = 77  # seventy-seven colour components
    assert isinstance(decode_image(bytes(data)), Unreadable)


def test_a_missing_file_is_unreadable(tmp_path: Path) -> None:
    assert load_image(tmp_path / "none.jpg") == Unreadable("cannot be read (No such file or directory)")


def test_a_frame_that_was_overwritten_is_not_taken_for_the_one_that_was_found(tmp_path: Path) -> None:
    path, data = tmp_path / "a.png", encoded(".png")
    path.write_bytes(data)
    frame = Frame(name="a.png", path=path, content_hash=content_hash(data), size=len(data), received=0, modified=0)
    assert isinstance(load_frame(frame), np.ndarray)
    path.write_bytes(encoded(".png", picture(seed=1)))
    assert load_frame(frame) == Unreadable("overwritten since it was found")
