"""Image files for the tests, made by OpenCV and, where it cannot, by hand."""

from __future__ import annotations

import io
import struct
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray


def picture(width: int = 160, height: int = 120, seed: int = 0, kind: type = np.uint8) -> NDArray[Any]:
    """Smooth colours, so that lossy files stay close to them."""
    coarse: NDArray[Any] = np.random.default_rng(seed).integers(0, np.iinfo(kind).max, (6, 8, 3)).astype(kind)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)


def encoded(suffix: str, image: NDArray[Any] | None = None, *options: int) -> bytes:
    done, data = cv2.imencode(suffix, picture() if image is None else image, options)
    assert done
    return data.tobytes()


def counts(bands: int, kind: type = np.uint16, seed: int = 0) -> NDArray[Any]:
    """(120, 160, bands), every band its own picture."""
    return np.dstack([picture(seed=seed + band, kind=kind)[..., 0] for band in range(bands)])


def many_bands(bands: int, kind: type = np.uint16, **options: Any) -> bytes:
    """A TIFF of `counts`; `options` are those of `tifffile.imwrite`."""
    image, file = counts(bands, kind), io.BytesIO()
    image = image[..., 0] if bands == 1 else image
    if options.get("planarconfig") == "separate":
        image = np.ascontiguousarray(np.moveaxis(image, -1, 0))
    usual = {"photometric": "minisblack", "metadata": None} | ({"planarconfig": "contig"} if bands > 1 else {})
    tifffile.imwrite(file, image, **(usual | options))
    return file.getvalue()


def with_thumbnail(jpeg: bytes) -> bytes:
    """The JPEG with a whole small JPEG inside an APP1 segment, as cameras write it."""
    thumbnail = b"Exif\0\0" + encoded(".jpg", picture(40, 30))
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", 2 + len(thumbnail)) + thumbnail + jpeg[2:]


def turned(jpeg: bytes) -> bytes:
    """The JPEG with an EXIF orientation of 6: to be shown turned by 90 degrees."""
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", 2 + len(exif)) + exif + jpeg[2:]


def photographed(date: bytes, fraction: bytes = b"", order: str = "<", big: bool = False) -> bytes:
    """A TIFF structure with a time as cameras write it: first directory, Exif directory, DateTimeOriginal and
    SubSecTimeOriginal; the texts end where they end."""
    head, place, count, entry = (16, "Q", "Q", "HHQ") if big else (8, "I", "H", "HHI")
    inline = struct.calcsize(order + place)
    texts = [(0x9003, date)] + ([(0x9291, fraction)] if fraction else [])
    size = struct.calcsize(order + entry) + inline
    inner = head + struct.calcsize(order + count) + size + inline
    after = inner + struct.calcsize(order + count) + len(texts) * size + inline
    start = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "H", 43 if big else 42)
    start += struct.pack(order + "HHQ", 8, 0, head) if big else struct.pack(order + "I", head)
    first = struct.pack(order + count + entry, 1, 0x8769, 4, 1)
    first += struct.pack(order + "I", inner).ljust(inline, b"\0") + bytes(inline)
    second, late = struct.pack(order + count, len(texts)), b""
    for tag, text in texts:
        value = text.ljust(inline, b"\0") if len(text) <= inline else struct.pack(order + place, after + len(late))
        second += struct.pack(order + entry, tag, 2, len(text)) + value
        late += text if len(text) > inline else b""
    return start + first + second + bytes(inline) + late


def with_exif(jpeg: bytes, exif: bytes) -> bytes:
    """The JPEG with a TIFF structure in an APP1 segment behind another one that is none of ours."""
    segments = [b"http://ns.adobe.com/xap/1.0/\0", b"Exif\0\0" + exif]
    return jpeg[:2] + b"".join(b"\xff\xe1" + struct.pack(">H", 2 + len(s)) + s for s in segments) + jpeg[2:]


def many_scans(jpeg: bytes, times: int) -> bytes:
    """The progressive JPEG with its last scan so many times: small, right, and slow to decode."""
    last = jpeg.rindex(b"\xff\xda")
    return jpeg[:last] + jpeg[last:-2] * times + jpeg[-2:]


def cut(jpeg: bytes, share: float) -> bytes:
    """The first part of a JPEG, closed with an end marker."""
    return jpeg[: int(share * len(jpeg))] + b"\xff\xd9"


def textured(width: int = 400, height: int = 300) -> NDArray[Any]:
    """Colours of much detail."""
    fine = np.random.default_rng(1).integers(0, 255, (height, width, 3)).astype(np.uint8)
    blurred: NDArray[Any] = cv2.GaussianBlur(fine, (0, 0), 1.5)
    return blurred
