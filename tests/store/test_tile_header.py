"""Tiles are known by their headers."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from gcs_mosaic.store.tile_header import is_tile_sized


def jpeg(size: int, quality: int = 90) -> bytes:
    return cv2.imencode(".jpg", np.full((size, size, 3), 90, np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()


def png(width: int, height: int) -> bytes:
    return cv2.imencode(".png", np.full((height, width), 90, np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    ("data", "is_one"),
    [
        (jpeg(256), True),
        (jpeg(255), False),
        (png(256, 256), True),
        (png(256, 255), False),
        (png(255, 256), False),
        (jpeg(256)[:2], False),
        (jpeg(256)[:20], False),
        (png(256, 256)[:20], False),
        (b"GIF89a" + bytes(30), False),
        (b"", False),
        (b"\xff\xd8\xff\xe0\x00\x00\xff\xc0\x00\x11\x08" + struct.pack(">HH", 256, 256), True),
        (b"\xff\xd8\xff\xc4\x00\x04\x00\x00\xff\xc2\x00\x11\x08" + struct.pack(">HH", 256, 256), True),
        (b"\xff\xd8\xff\xc2\x00\x11\x08" + struct.pack(">HH", 256, 257), False),
        (b"\xff\xd8\xfe\xc0\x00\x11\x08" + struct.pack(">HH", 256, 256), False),
    ],
)
def test_a_tile_is_known_by_its_header(data: bytes, is_one: bool) -> None:
    assert is_tile_sized(data) is is_one
