"""A camera of several bands: each lens stands a little beside the others, and sees the ground in another contrast."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

WIDTH, HEIGHT = 640, 480
BORDER = 60  # pixels that the ground goes on around what the reference sees
BANDS = (1, 2, 3, 4, 5)  # as MicaSense numbers them; 2 is mapped
SHIFTS = {1: (-14.0, 9.0), 2: (0.0, 0.0), 3: (22.5, -10.25), 4: (-31.0, -17.5), 5: (10.0, 40.0)}  # px
TURNS_DEG = {1: 0.5, 2: 0.0, 3: -0.3, 4: 0.25, 5: -0.5}
SCALES = {1: 1.01, 2: 1.0, 3: 0.995, 4: 1.0, 5: 0.99}

Grey = NDArray[np.float32]


def place_of(band: int) -> NDArray[np.float64]:
    """Homography from the reference's pixels to this band's."""
    turned = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), TURNS_DEG[band], SCALES[band])
    turned[:, 2] += np.array(SHIFTS[band])
    return np.vstack([turned, [0.0, 0.0, 1.0]])


def in_contrast_of(band: int, ground: Grey) -> Grey:
    """Grey levels of 0 to 1 as this band has them; the fourth (near infrared) is inverted where it is dark."""
    by_band = {
        1: ground**2,
        2: ground,
        3: 0.3 + 0.5 * np.sqrt(ground),
        4: 1.0 - ground,
        5: np.abs(ground - 0.35) + 0.2,
    }
    return np.asarray(by_band[band], np.float32)


def seen(ground: Grey, band: int, seed: int = 0) -> NDArray[np.uint16]:
    """(HEIGHT, WIDTH) counts of a band; `ground` (HEIGHT + 2 BORDER, WIDTH + 2 BORDER) around what the reference sees."""
    from_reference = np.array([[1.0, 0.0, BORDER], [0.0, 1.0, BORDER], [0.0, 0.0, 1.0]])
    to_ground = from_reference @ np.linalg.inv(place_of(band))
    laid = cv2.warpPerspective(ground, to_ground, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    noise = np.random.default_rng(1000 * seed + band).normal(scale=80, size=laid.shape)
    counts = 4000 + 30000 * in_contrast_of(band, np.clip(laid, 0, 1)) + noise
    return np.asarray(np.clip(counts, 0, 65535), np.uint16)


def cut(ground: NDArray[Any], x: int, y: int) -> Grey:
    """What `seen` looks at, of a ground (n, n) of 8 bits."""
    part = ground[y : y + HEIGHT + 2 * BORDER, x : x + WIDTH + 2 * BORDER]
    return np.asarray((part if part.ndim == 2 else part[..., 1]) / np.float32(255), np.float32)


def tiff_of(counts: NDArray[Any], when: datetime | None = None) -> bytes:
    """As cameras write a band; `when`: the capture time that it tells."""
    if when is None:
        return _tiff(counts)
    # Behind the picture a directory of one entry, the capture time, whose text follows it. Its place is in a tag that is called
    # otherwise first, for it is not written by that name.
    at = len(_tiff(counts, 0)) + 1 & ~1
    data = (
        _tiff(counts, at)
        .ljust(at, b"\0")
        .replace(struct.pack("<HHII", _PLACE, 4, 1, at), _EXIF + struct.pack("<I", at))
    )
    entry = struct.pack("<HHII", 0x9003, 2, 20, at + 18)
    return data + struct.pack("<H", 1) + entry + bytes(4) + f"{when:%Y:%m:%d %H:%M:%S}\0".encode()


_PLACE = 65000
_EXIF = struct.pack("<HHI", 0x8769, 4, 1)


def _tiff(counts: NDArray[Any], place: int | None = None) -> bytes:
    file = io.BytesIO()
    tags = [] if place is None else [(_PLACE, "I", 1, place, True)]
    tifffile.imwrite(file, counts, photometric="minisblack", metadata=None, extratags=tags, byteorder="<")
    return file.getvalue()


def write_shot(folder: Path, number: int, ground: Grey, bands: Sequence[int] = BANDS) -> None:
    """IMG_0000_1.tif and so on."""
    folder.mkdir(parents=True, exist_ok=True)
    for band in bands:
        (folder / file_of(number, band)).write_bytes(tiff_of(seen(ground, band, number)))


def file_of(number: int, band: int) -> str:
    return f"IMG_{number:04}_{band}.tif"
