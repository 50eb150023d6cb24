from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from image_files import encoded, picture, turned

from gcs_mosaic.events import Frame
from gcs_mosaic.frames.content import content_hash
from gcs_mosaic.frames.load import Unreadable, decode_image, load_frame, load_image


def difference(data: bytes, wanted: np.ndarray) -> float:
    image = decode_image(data)
    assert isinstance(image, np.ndarray)
    assert (image.dtype, image.shape) == (np.uint8, wanted.shape)
    return float(np.abs(image.astype(int) - wanted).max())


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_pixels_come_back_as_they_were(suffix: str) -> None:
    assert difference(encoded(suffix), picture()) == 0


def test_a_jpeg_comes_back_nearly() -> None:
    assert difference(encoded(".jpg", None, cv2.IMWRITE_JPEG_QUALITY, 98), picture()) < 12


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_sixteen_bits_are_scaled_to_eight(suffix: str) -> None:
    deep = picture(kind=np.uint16)
    assert difference(encoded(suffix, deep), deep // 257) <= 1


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_grey_becomes_three_equal_bands(suffix: str) -> None:
    grey = picture()[..., 0]
    assert difference(encoded(suffix, grey), np.dstack([grey] * 3)) == 0


def test_orientation_is_not_applied() -> None:
    image = decode_image(turned(encoded(".jpg")))
    assert isinstance(image, np.ndarray)
    assert image.shape == (120, 160, 3)


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
