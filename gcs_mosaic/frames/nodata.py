"""Pixels that hold no picture, as a file says itself: by transparency, by a nodata value, or by numbers that are none."""

from __future__ import annotations

import logging
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.bands import decode_samples
from gcs_mosaic.frames.decode import Unreadable, bytes_of, stored_numbers
from gcs_mosaic.frames.exif import first_texts
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.structure import StructureError
from gcs_mosaic.frames.tiff import as_stored, first_page
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.arrays import AnyImage, Bands, Mask

logger = logging.getLogger(__name__)

_PNG, _TIFF = b"\x89PNG", (b"II", b"MM")
_COLOUR_TYPE, _WITH_ALPHA = 25, (4, 6)  # of a PNG: where it stands, and those with a sample of alpha
_TRANSPARENCY, _DATA = b"tRNS", b"IDAT"
_FLOATS, _NODATA = 3, 42113  # sample format of a TIFF, and GDAL's tag
_SAMPLES = 4  # that OpenCV gives back with alpha


def told_picture(frame: Frame, image: Bands) -> Mask | None:
    """Which pixels of a frame (h, w), reduced or not, hold a picture; None if its file says of none that it does not.

    `image`: what it was decoded to, in a process of its own: what is decoded again here can be trusted.
    """
    if not _may_tell(frame):
        return None
    data = bytes_of(frame)
    if isinstance(data, Unreadable):
        return None
    try:
        holds = _of_png(data) if data.startswith(_PNG) else _of_tiff(data, image)
    except (StructureError, cv2.error, ValueError):
        logger.info("what of %s holds no picture cannot be told", frame.name, exc_info=True)
        return None
    return None if holds is None or holds.all() else holds


def _may_tell(frame: Frame) -> bool:
    """Whether it is a PNG or a TIFF, by its first bytes."""
    start = frame.data
    if start is None:
        try:
            with frame.path.open("rb") as file:
                start = file.read(len(_PNG))
        except OSError:
            logger.info("%s cannot be read again", frame.name, exc_info=True)
            return False
    return start.startswith((_PNG, *_TIFF))


def _of_png(data: bytes) -> Mask | None:
    coloured = data[_COLOUR_TYPE] if len(data) > _COLOUR_TYPE else 0
    if coloured not in _WITH_ALPHA and _TRANSPARENCY not in data[: data.find(_DATA)]:
        return None
    return _opaque(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


def _of_tiff(data: bytes, image: Bands) -> Mask | None:
    page = first_page(data)
    if page.transparent:
        if page.samples == _SAMPLES and not page.planar:
            return _opaque(cv2.imdecode(np.frombuffer(as_stored(data), np.uint8), cv2.IMREAD_UNCHANGED))
        return np.asarray(decode_samples(data, page)[..., page.transparent[0]] > 0)
    nodata = _number(first_texts(BytesIO(data), (_NODATA,)).get(_NODATA, ""))
    if nodata is not None and np.isfinite(nodata):
        whole = is_whole(data)
        stored = None if isinstance(whole, NotWhole) else stored_numbers(data, whole, 1)
        return None if stored is None else _known(stored, nodata)
    # Of floats the count is 0 for what is no number.
    return np.asarray(image.any(axis=2)) if page.formats == {_FLOATS} else None


def _known(stored: NDArray[Any], nodata: float) -> Mask:
    """Pixels (h, w) of which a band is a number, and another one than `nodata`."""
    other = ~np.isclose(stored, nodata, rtol=1e-6, atol=0)
    return np.asarray((other & np.isfinite(stored)).any(axis=2))


def _opaque(image: AnyImage | None) -> Mask | None:
    with_alpha = image is not None and image.ndim == 3 and image.shape[2] == _SAMPLES
    return np.asarray(image[..., -1] > 0) if image is not None and with_alpha else None


def _number(text: str) -> float | None:
    try:
        return float(text.strip("\0 "))
    except ValueError:
        return None
