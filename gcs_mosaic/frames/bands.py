"""TIFFs that OpenCV cannot read: two bands, more than three, planar storage, or numbers that not all its versions know; and the
reason for those that are not supported at all."""

from __future__ import annotations

import io
import logging
import zlib
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from gcs_mosaic.frames.structure import StructureError
from gcs_mosaic.frames.tiff import TiffPage, first_page

logger = logging.getLogger(__name__)

_NONE, _DEFLATE = 1, (8, 32946)
_COUNTS = frozenset({1, 4})  # sample formats: unsigned integer, and undefined
_SIGNED, _FLOATS = 2, 3
_BITS = {1: (8, 16, 32), _SIGNED: (8, 16, 32), _FLOATS: (16, 32, 64)}  # by format


def needs_bands(data: bytes) -> bool:
    """Whether a complete image file is a TIFF for `decode_bands`."""
    if not data.startswith((b"II", b"MM")):
        return False
    page = first_page(data)
    bands = page.samples - len(page.transparent)
    as_counts = page.formats <= _COUNTS and page.bits <= 16
    as_floats = page.formats == {_FLOATS} and page.bits in (32, 64)
    return not (as_counts or as_floats) or bands not in (1, 3) or (page.planar and page.samples > 1)


def decode_bands(data: bytes) -> NDArray[Any]:
    """(height, width, bands) of a TIFF's first page without transparency, as they are stored; three bands as blue, green, red.

    Raises StructureError, with the reason, for unsupported files: other samples than integers of 8 to 32 bits or floats,
    compression other than Deflate, or more data than the page has pixels.
    """
    page = first_page(data)
    bands = np.delete(decode_samples(data, page), page.transparent, axis=2)
    native = bands.astype(bands.dtype.newbyteorder("="), copy=False)
    return np.ascontiguousarray(native[..., ::-1] if native.shape[2] == 3 else native)


def decode_samples(data: bytes, page: TiffPage) -> NDArray[Any]:
    """All samples (height, width, samples) of a TIFF's first page, in the file's order. Raises StructureError as above."""
    kind = 1 if page.formats <= _COUNTS else min(page.formats) if len(page.formats) == 1 else 0
    if page.bits not in _BITS.get(kind, ()):
        said = {0: "several kinds of numbers", 1: "counts", _SIGNED: "counts with a sign", _FLOATS: "floats"}
        what = f"{said.get(kind, 'complex numbers')} of {page.bits} bits"
        raise StructureError(f"{what} are not read: bands have counts of 8 to 32 bits, or floats of 16 to 64")
    _refuse_bombs(data, page)
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            image = file.pages[0].asarray(maxworkers=1)
    except Exception as error:  # the library may raise anything on a damaged file
        logger.info("a TIFF cannot be decoded", exc_info=True)
        raise StructureError(f"damaged: {error}") from error
    if image.size != page.height * page.width * page.samples:
        raise StructureError("damaged: its data are not as many as its size says")
    if page.planar and image.ndim == 3:
        image = np.moveaxis(image, 0, -1)
    return image.reshape(page.height, page.width, page.samples)


def _refuse_bombs(data: bytes, page: TiffPage) -> None:
    """The library decompresses a piece without a size limit."""
    if page.compression == _NONE:
        return
    if page.compression not in _DEFLATE:
        raise StructureError(
            f"compression {page.compression} is not read for {page.samples} bands of {page.bits} bits: "
            "save without, or as Deflate"
        )
    for offset, count in page.pieces:
        unpacking = zlib.decompressobj()
        try:
            unpacked = unpacking.decompress(data[offset : offset + count], page.piece_bytes + 1)
        except zlib.error as error:
            raise StructureError(f"damaged: {error}") from error
        if len(unpacked) > page.piece_bytes:
            raise StructureError("damaged: a TIFF with more data than pixels")
