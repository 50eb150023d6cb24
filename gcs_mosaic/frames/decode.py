"""Decoding an image file to pixels, or the reason why it fails."""

from __future__ import annotations

import logging
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.bands import decode_bands, needs_bands
from gcs_mosaic.frames.flir import counts_in
from gcs_mosaic.frames.integrity import MAX_PIXELS, NotWhole, is_whole
from gcs_mosaic.frames.jpeg import jpeg_picture
from gcs_mosaic.frames.jpeg_mend import continued, has_its_end, mended, rows_missing
from gcs_mosaic.frames.numbers import MOST_THERMAL, NumberScale, counts_of, scale_of
from gcs_mosaic.frames.png import mended_png
from gcs_mosaic.frames.structure import StructureError, Whole, image_start
from gcs_mosaic.frames.tiff import as_stored, continued_tiff, first_page, refuse_unread, unwritten
from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.stitch.arrays import Bands

logger = logging.getLogger(__name__)


# Pixels as captured: applying the orientation tag would change the camera's geometry.
_AS_TAKEN = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_COLOUR = {1: cv2.IMREAD_COLOR, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4}
_GREY = {1: cv2.IMREAD_GRAYSCALE, 2: cv2.IMREAD_REDUCED_GRAYSCALE_2, 4: cv2.IMREAD_REDUCED_GRAYSCALE_4}
_JPEG, _TIFF = b"\xff\xd8", (b"II", b"MM")
ORDINARY_BYTES = 256_000_000  # up to which a file is read to see whether it is what was found


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why a file cannot be decoded; `passing`: by the machine or the moment, not by its bytes."""

    reason: str
    passing: bool = field(default=False, compare=False)


def load_frame(frame: Frame, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> Bands | Unreadable:
    """The frame's pixels as in `decode_image`; Unreadable also if the file has changed since it was found."""
    data = bytes_of(frame)
    return data if isinstance(data, Unreadable) else decode_image(data, max_pixels, reduction)


def bytes_of(frame: Frame) -> bytes | Unreadable:
    """The frame's file, exactly as it was found."""
    if frame.data is not None:
        return frame.data
    data = _read(frame.path, frame.size)
    if isinstance(data, bytes) and content_hash(data) != frame.content_hash:
        return Unreadable("overwritten since it was found", passing=True)
    return data


def load_image(path: Path, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> Bands | Unreadable:
    """The pixels of the file at `path` as in `decode_image`."""
    data = _read(path)
    return data if isinstance(data, Unreadable) else decode_image(data, max_pixels, reduction)


def decode_image(data: bytes, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> Bands | Unreadable:
    """(height, width, bands) uint8 or uint16 from a JPEG, PNG or TIFF, without transparency: three bands are blue, green
    and red, others are in file order. Of a radiometric JPEG its counts, see `flir`; of other numbers as `numbers` tells.

    A `reduction` of 2 or 4 gives half or a quarter of the size (rounded up); a JPEG is decoded directly at that size.
    """
    whole = is_whole(data, max_pixels)
    if isinstance(whole, NotWhole):
        return Unreadable(whole.reason)
    return counts_instead(data, decode_whole(data, whole, reduction), whole, reduction)


def decode_whole(data: bytes, whole: Whole, reduction: int = 1, *, is_proven: bool = False) -> Bands | Unreadable:
    """The picture of a file with this header, before `counts_instead`. Where that is in doubt, rows are looked for that are
    missing, unless it `is_proven` that none are."""
    try:
        image = _decoded(data, whole, reduction) if not whole.doubt else None
        if image is None:
            image = _decoded_mended(data, whole, reduction, is_proven=is_proven)
    except StructureError as error:
        return Unreadable(str(error))
    except cv2.error as error:
        logger.info("a picture cannot be decoded", exc_info=True)
        return Unreadable(f"cannot be decoded ({error.err or 'unknown reason'})", error.code == cv2.Error.StsNoMem)
    if image is None:
        return Unreadable(f"cannot be decoded{_why(data, whole)}")
    wanted = reduced_shape(whole, reduction)
    if image.shape != wanted or image.dtype not in (np.uint8, np.uint16):
        return Unreadable(f"decodes to {image.shape} {image.dtype}, not to counts of 8 or 16 bits {wanted}")
    return image


def number_scale(data: bytes) -> NumberScale | None:
    """By which a thermal camera's TIFF became counts; None of what is none, or cannot be decoded."""
    whole = is_whole(data, MOST_THERMAL)
    if isinstance(whole, NotWhole) or not data.startswith(_TIFF):
        return None
    try:
        stored = stored_numbers(data, whole, 1)
        return None if stored is None else scale_of(stored)
    except (StructureError, cv2.error):
        return None


def counts_instead(data: bytes, picture: Bands | Unreadable, whole: Whole, reduction: int = 1) -> Bands | Unreadable:
    """The counts that a file has beside the picture it decodes to; that picture if it has none."""
    if isinstance(picture, Unreadable) or not data.startswith(_JPEG):
        return picture
    found = counts_in(data, (whole.width, whole.height))
    counts = None if found is None else found.pixels()
    if counts is None:
        return picture
    return _reduced(counts[..., None], reduction) if reduction > 1 else counts[..., None]


def share_missing(data: bytes, whole: Whole, image: Bands, reduction: int = 1) -> float:
    """Share of the rows of `image`, which a JPEG was decoded to, that are not all in the file."""
    picture = jpeg_picture(data)
    other = _decoded(continued(data, picture), whole, reduction)
    return 1.0 if other is None else rows_missing(picture, image, other, reduction) / image.shape[0]


def ends_early(share: float, height: int) -> str:
    """What is wrong with a JPEG of so many rows, of which this share is missing."""
    return f"the JPEG's data end before the picture does, {share:.0%} of {height} rows are missing"


def reduced_shape(whole: Whole, reduction: int) -> tuple[int, int, int]:
    """(height, width, bands) of a picture reduced by an integer factor."""
    return -(-whole.height // reduction), -(-whole.width // reduction), whole.bands


def _why(data: bytes, whole: Whole) -> str:
    """What is known of a picture that no decoder takes, as the end of a sentence."""
    kind, _ = image_start(data) or ("", 0)
    frame = jpeg_picture(data).frame if kind == "jpeg" else None
    if frame is not None and (unusual := frame.unusual):
        return f": {unusual} is not read, save it as an ordinary JPEG"
    return f" ({whole.doubt})" if whole.doubt else ""


def _decoded_mended(data: bytes, whole: Whole, reduction: int, *, is_proven: bool) -> Bands | None:
    """Of what is needed of the file alone. Raises StructureError if rows are missing."""
    kind, _ = image_start(data) or ("", 0)
    if kind == "png":
        return _decoded(mended_png(data), whole, reduction)
    if kind == "tiff":
        return _tiff_in_doubt(data, whole, reduction) if whole.doubt else None
    picture = jpeg_picture(data)
    image = _decoded(mended(data, picture), whole, reduction)
    if image is None or is_proven or picture.ended or has_its_end(picture, image, reduction):
        return image
    if share := share_missing(data, whole, image, reduction):
        raise StructureError(f"truncated: {ends_early(share, whole.height)}")
    return image


def _tiff_in_doubt(data: bytes, whole: Whole, reduction: int) -> Bands | None:
    """Raises StructureError if strips are missing, which OpenCV paints black."""
    page = first_page(data)
    if share := unwritten(data, page):
        raise StructureError(f"damaged: {share:.0%} of the TIFF's strips were not written")
    image, more = _decoded(data, whole, reduction), continued_tiff(data, page)
    other = image if more is None else _decoded(more, whole, reduction)
    if image is not None and (other is None or not np.array_equal(image, other)):
        raise StructureError("truncated: the TIFF's data end before the picture does")
    return image


def _decoded(data: bytes, whole: Whole, reduction: int) -> Bands | None:
    at_once = reduction if data.startswith(_JPEG) else 1
    stored = stored_numbers(data, whole, at_once)
    image = None if stored is None else counts_of(stored)
    return image if image is None or at_once == reduction else _reduced(image, reduction)


def stored_numbers(data: bytes, whole: Whole, reduction: int) -> NDArray[Any] | None:
    """Of a whole file the numbers (h, w, bands) of any kind that it holds. Raises StructureError."""
    if needs_bands(data):
        return decode_bands(data)
    if data.startswith(_TIFF):
        refuse_unread(first_page(data))
    return _by_opencv(data, whole, reduction)


def _by_opencv(data: bytes, whole: Whole, reduction: int) -> NDArray[Any] | None:
    """One band or three, of counts or floats."""
    flags = (_GREY if whole.bands == 1 else _COLOUR)[reduction] | _AS_TAKEN
    stored = as_stored(data) if data.startswith(_TIFF) else data  # IMREAD_IGNORE_ORIENTATION is not for TIFFs
    image = cv2.imdecode(np.frombuffer(stored, np.uint8), flags)
    return image if image is None or image.ndim == 3 else image[..., None]


def _reduced(image: Bands, reduction: int) -> Bands:
    """The mean of each square of `reduction` pixels; at the far borders the last row or column is repeated."""
    below, right = -image.shape[0] % reduction, -image.shape[1] % reduction
    size = (image.shape[1] + right) // reduction, (image.shape[0] + below) // reduction
    bands = [
        cv2.resize(
            cv2.copyMakeBorder(np.ascontiguousarray(image[..., band]), 0, below, 0, right, cv2.BORDER_REPLICATE),
            size,
            interpolation=cv2.INTER_AREA,
        )
        for band in range(image.shape[2])
    ]
    return np.stack(bands, axis=-1)


def _read(path: Path, size: int | None = None) -> bytes | Unreadable:
    """A regular file; `size`: of what is expected, beyond which nothing is read. A pipe or a device may have no end."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        with os.fdopen(os.open(path, flags), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                return Unreadable("cannot be read (not a regular file)", passing=True)
            if size is not None and found.st_size > max(size, ORDINARY_BYTES):
                return Unreadable("overwritten since it was found", passing=True)
            return file.read()
    except OSError as error:
        return Unreadable(f"cannot be read ({error.strerror})", passing=True)
