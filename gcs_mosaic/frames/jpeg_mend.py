"""A JPEG as decoders want it: the main picture alone, with an end marker; and whether anything of it is missing.

libjpeg fills what is missing with grey. Whether it did so is asked by decoding the picture a second time, with other bytes
behind its data: what then looks different was not in the file.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.jpeg import JpegPicture
from gcs_mosaic.frames.jpeg_segments import SEQUENTIAL
from gcs_mosaic.stitch.arrays import Bands

_BEGIN, _END = b"\xff\xd8", b"\xff\xd9"
_RESTART = re.compile(rb"\xff([\xd0-\xd7])")
# Of every restart interval; more than any unit of 10 blocks of 64 coefficients takes.
_NOISE = np.random.default_rng(0).integers(0, 255, 4096, np.uint8).tobytes()  # below 255: no markers
NOTHING_CAME = 128  # the value of pixels whose coefficients are all zero
UNSHARP = 2  # pixels by which colours of lower resolution reach into their neighbourhood


def mended(data: bytes, picture: JpegPicture) -> bytes:
    """The main picture of a JPEG file, which lies there."""
    return _rebuilt(data, picture, b"")


def continued(data: bytes, picture: JpegPicture) -> bytes:
    """The main picture with other bytes behind its data."""
    return _rebuilt(data, picture, _more(data, *picture.parts[-1]))


def has_its_end(picture: JpegPicture, image: Bands, reduction: int = 1) -> bool:
    """Whether the last pixel of `image` shows that the picture's last unit (MCU) was in the file. If not, nothing is known."""
    frame, (height, width) = picture.frame, image.shape[:2]
    # What is missing is blurred in a progressive picture, made up by arithmetic coding; of several scans some are there.
    if frame is None or frame.marker not in SEQUENTIAL or len(picture.scans) > 1 or len(frame.components) not in (1, 3):
        return False
    across, down = (max(size // reduction, 1) for size in frame.unit)
    inside = min((width - 1) % across, (height - 1) % down) >= UNSHARP
    return inside and bool((image[-1, -1] != NOTHING_CAME).any())


def rows_missing(picture: JpegPicture, image: Bands, other: Bands, reduction: int = 1) -> int:
    """How many rows of `image` (h, w, bands) at the end are not all in the file; `other`: as decoded from `continued(data)`.

    A unit (MCU) whose last bits alone are missing is there: some cameras leave them out.
    """
    differs = _rows_that_differ(image, other)
    if not differs.any():
        return 0
    assert picture.frame is not None, "it has been decoded"
    first, (height, width) = int(differs.argmax()), image.shape[:2]
    across, down = (max(size // reduction, 1) for size in picture.frame.unit)
    top, left = (height - 1) // down * down - UNSHARP, max((width - 1) // across * across - UNSHARP, 0)
    in_last_unit = first >= top and np.array_equal(image[first:, :left], other[first:, :left])
    return 0 if in_last_unit else height - first


def _rows_that_differ(image: Bands, other: Bands) -> NDArray[np.bool_]:
    return np.array([not np.array_equal(a, b) for a, b in zip(image, other, strict=True)])


def _rebuilt(data: bytes, picture: JpegPicture, more: bytes) -> bytes:
    return b"".join([_BEGIN, *(data[begin:end] for begin, end in picture.parts), more, _END])


def _more(data: bytes, begin: int, end: int) -> bytes:
    """Noise, which has a restart marker wherever one may be expected."""
    last = 7
    for found in _RESTART.finditer(data, begin, end):
        last = found[1][0] - 0xD0
    return _NOISE + b"".join(bytes([0xFF, 0xD0 + (last + more) % 8]) + _NOISE for more in range(1, 9))
