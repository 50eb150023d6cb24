"""The same picture in new bytes: taggers (exiftool -overwrite_original) rewrite files that a camera has just written."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import tifffile

from gcs_mosaic.frames.picture_hash import picture_hash
from tests.frames.image_files import encoded, picture, turned, with_thumbnail

PICTURES = {"a": picture(), "b": picture(seed=1)}


def tiff(image: np.ndarray, **options: Any) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, image, metadata=None, **options)
    return file.getvalue()


def png_with_text(data: bytes) -> bytes:
    """With a tEXt chunk before the picture; its checksum is not looked at."""
    return data[:33] + struct.pack(">I", 5) + b"tEXtX\0abcXXXX"[: 4 + 5 + 4] + data[33:]


def commented(jpeg: bytes) -> bytes:
    return jpeg[:2] + b"\xff\xfe" + struct.pack(">H", 8) + b"tagged" + jpeg[2:]


SAME = {
    "thumbnail": ("jpg", with_thumbnail),
    "orientation": ("jpg", turned),
    "comment": ("jpg", commented),
    "behind the end": ("jpg", lambda data: data + b"a maker's trailer\xff\xd9"),
    "png text": ("png", png_with_text),
}


@pytest.mark.parametrize(("kind", "change"), SAME.values(), ids=SAME.keys())
def test_what_is_told_beside_a_picture_does_not_change_it(kind: str, change: Callable[[bytes], bytes]) -> None:
    hashes = {name: picture_hash(encoded(f".{kind}", image)) for name, image in PICTURES.items()}
    assert hashes["a"] != hashes["b"]
    assert picture_hash(change(encoded(f".{kind}", PICTURES["a"]))) == hashes["a"]


def test_a_tiff_with_more_tags_is_the_same_picture() -> None:
    grey = {name: image[..., 0].astype(np.uint16) for name, image in PICTURES.items()}
    assert picture_hash(tiff(grey["a"])) == picture_hash(tiff(grey["a"], description="tagged", software="a tagger"))
    assert picture_hash(tiff(grey["a"])) != picture_hash(tiff(grey["b"]))


def test_progressive_pictures_are_told_apart() -> None:
    import cv2

    one, other = (encoded(".jpg", image, cv2.IMWRITE_JPEG_PROGRESSIVE, 1) for image in PICTURES.values())
    assert picture_hash(one) not in (None, picture_hash(other))


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xd8", b"\xff\xd8\xff\xe1\x00", b"II*\0", b"MM\0*\0\0\0\x08", b"\x89PNG\r\n\x1a\n\0"]
)
def test_half_a_file_has_no_hash_or_one_of_its_own(data: bytes) -> None:
    assert picture_hash(data) != picture_hash(encoded(".jpg"))
