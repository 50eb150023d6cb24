"""What the search for inputs begins with: small whole ones of each kind, made here."""

from __future__ import annotations

import io
import struct
from collections import Counter, OrderedDict
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
import tifffile

from gcs_mosaic.config.settings_file import documented_defaults
from gcs_mosaic.notes.finds.finds import Find, PlacedFind
from gcs_mosaic.notes.ground.binding import Binding, GroundPlace
from gcs_mosaic.notes.ground.places import GeoPlace
from gcs_mosaic.store.checkpoint import encoded as pickled
from tests.frames.image_files import encoded, photographed, picture, turned, with_exif, with_thumbnail
from tests.mavlink.mavlink_peer import captured, feedback, heartbeat, packet, recorded, trigger

SMALL = picture(24, 16)
BEGAN = 1.7e9  # seconds since 1970

_QUESTION = "service=WMS&version={}&request=GetMap&layers=mosaic&{}&format=image/{}"
_BOXES = (
    "srs=EPSG:3857&bbox=0,0,1000,1000&width=256&height=256",
    "crs=EPSG:4326&bbox=48.1,11.5,48.2,11.6&width=4096&height=1&transparent=true",
    "crs=CRS:84&bbox=-180,-90,180,90&width=512&height=256&bgcolor=0x102030&styles=default",
)


def tiffs() -> list[bytes]:
    whole = encoded(".tiff", SMALL, cv2.IMWRITE_TIFF_COMPRESSION, 1)
    return [
        whole,
        _small_bands(2),
        _small_bands(5, compression="zlib"),
        _small_bands(4, planarconfig="separate"),
        _small_bands(2, bigtiff=True),
        _small_bands(2, byteorder=">"),
        _small_bands(2, tile=(16, 16)),
    ]


def _small_bands(bands: int, **options: Any) -> bytes:
    """A TIFF of 24 x 16 pixels; `options` are those of `tifffile.imwrite`."""
    image, file = np.zeros((16, 24, bands), np.uint8), io.BytesIO()
    if options.setdefault("planarconfig", "contig") == "separate":
        image = np.moveaxis(image, -1, 0)
    tifffile.imwrite(file, image, photometric="minisblack", metadata=None, **options)
    return file.getvalue()


def jpegs() -> list[bytes]:
    plain = encoded(".jpg", SMALL)
    progressive = encoded(".jpg", SMALL, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    return [plain, progressive, encoded(".jpg", SMALL[..., 0]), with_thumbnail(plain), turned(plain)]


def exifs() -> list[bytes]:
    date, plain = b"2021:06:05 14:03:59", encoded(".jpg", SMALL)
    bare = [photographed(date, b"25", order, big) for order in "<>" for big in (False, True)]
    return [*bare, *(with_exif(plain, one) for one in bare), plain]


def tlogs() -> list[bytes]:
    messages = [heartbeat(), trigger(1), feedback(2), captured(3)]
    mixed = b"".join(struct.pack(">Q", int((BEGAN + k) * 1e6)) + packet(one) for k, one in enumerate(messages))
    return [mixed, b"".join(recorded(BEGAN + k, k) for k in range(4)), b"\xfe\x09" + bytes(20)]


def wms_questions() -> list[bytes]:
    ways = zip(("1.1.1", "1.3.0", ""), _BOXES, ("png", "jpeg", "webp"), strict=True)
    asked = [_QUESTION.format(*way) for way in ways]
    return [one.encode() for one in (*asked, "request=GetCapabilities", "REQUEST=map&WMTVER=1.0.0")]


def texts() -> list[bytes]:
    """UTF-16, in which halves of letters can stand alone, as in names of files that are no text."""
    told = ("a person", "=1+1", "<script>&\"'\u20ac\0\ud800]]>", "\ufffe\uffff\x1b[2J\r\n")
    return [one.encode("utf-16-le", "surrogatepass") for one in told]


def finds_of(text: str) -> list[PlacedFind]:
    """One without a place on earth, one with, of which all texts are this one."""
    binding = Binding(island=0, x=1.5, y=2.5, frame=text, pixel=(3.0, 4.0))
    told = dict.fromkeys(("kind", "label", "note", "who", "changed_by"), text)
    find = Find(
        id=7, revision=1, deleted=False, created_utc=0.0, changed_utc=1.0, in_original=False, binding=binding, **told
    )
    place = GroundPlace(island=0, x=1.5, y=2.5, number=1)
    return [PlacedFind(find, place, None), PlacedFind(find, place, GeoPlace(11.5, 48.1, 3.0))]


def settings() -> list[bytes]:
    whole = documented_defaults().encode()
    return [
        b"scale: 0.5\nstitch: {features: {kind: orb}}\n",
        b"sources: [{vehicle: 1, watch: a}, {vehicle: 2, rtsp: 'rtsp://h/x'}]\nhttp: null\n",
        b"decode: &a {cpu_s: 1}\nstream: *a\n",
        b"web: {<<: {open: true}}\n",
        b"[[[[{a: [1, 2]}]]]]",
        *(whole[at : at + 2000] for at in range(0, len(whole), 8000)),
    ]


def checkpoints() -> list[bytes]:
    mapping = MappingProxyType({"a": np.arange(4.0), 1: np.float32(2)})
    several = OrderedDict(a=Counter("abc"), b=frozenset({1, 2}), c=[None, True, 1.5, 2j, b"x", "y" * 40])
    return [pickled(mapping), pickled(several), pickled(finds_of("a")), pickled(np.zeros((2, 3), "F"))]


def control_points() -> list[bytes]:
    return [
        b"name,frame,px,py,latitude,longitude,sigma_m\na,b.jpg,1,2,48.1,11.5,0.02\n",
        b"label;island;x;y;coordinate\na;0;1;2;48.1 N 11.5 E\nb;0;3;4;32U 691000 5334000\n",
        b"EPSG:32632\n691000 5334000 500 10 20 a.jpg gcp1\n",
        b"WGS84 UTM 32N\n691000 5334000 500 10 20 a.jpg\n",
        b"+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs\n691000\t5334000\t500\t10\t20\ta.jpg\n",
    ]


def models() -> list[bytes]:
    """ONNX by hand: a graph (7) with an input (11) of the shape (1, 1, 480, n)."""
    sizes = b"".join(_field(1, b"\x08" + size) for size in (b"\x01", b"\x01", b"\xe0\x03")) + _field(1, _field(2, b"n"))
    given = _field(1, b"input") + _field(2, _field(1, b"\x08\x01" + _field(2, sizes)))
    return [_field(7, _field(11, given)), b"\x08\x08" + _field(7, _field(5, _field(8, b"w")) + _field(11, given))]


def _field(number: int, content: bytes) -> bytes:
    """A protobuf field with a length below 128."""
    return bytes([number << 3 | 2, len(content)]) + content
