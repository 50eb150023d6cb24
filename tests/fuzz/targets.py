"""The readers of what strangers send, each with seeds to begin from. A reader raises nothing but what it promises, which is
caught here; whatever else comes out is a find."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from hashlib import blake2b
from urllib.parse import parse_qsl
from xml.etree import ElementTree

import numpy as np

from gcs_mosaic.frames.bands import decode_bands, needs_bands
from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.integrity import is_whole
from gcs_mosaic.frames.structure import StructureError, Whole
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.tlog_reader import read_recording
from gcs_mosaic.notes.anchors.control_points import read_control_points
from gcs_mosaic.notes.finds.exports import as_csv, as_geojson, as_kml
from gcs_mosaic.stitch.features.onnx_check import declared_inputs
from gcs_mosaic.store import checkpoint
from gcs_mosaic.web.maps.wms import strip_of, tile_in
from gcs_mosaic.web.maps.wms_request import WmsFault, lower_names, map_request
from tests.fuzz import seeds
from tests.fuzz.judging import Reader
from tests.fuzz.written import LONGEST_SENTENCE, folder, one_sentence, written
from tests.settings import load_config

FEW_PIXELS = 1_000_000  # of a picture that is decoded, too: what a large one costs is bounded by the decoders' process


@dataclass(frozen=True, slots=True)
class Target:
    """`read` has one input read."""

    read: Reader
    seeds: Callable[[], list[bytes]]
    longest: int = 4096  # bytes of an input


def read_tiff(data: bytes) -> None:
    whole = is_whole(b"II*\0" + data[4:] if data[:2] not in (b"II", b"MM") else data)
    if not isinstance(whole, Whole) or whole.width * whole.height > FEW_PIXELS:
        return
    with suppress(StructureError):
        if needs_bands(data):
            decode_bands(data)


def read_jpeg(data: bytes) -> None:
    is_whole(data)
    is_whole(b"\xff\xd8\xff" + data[3:])


def read_exif(data: bytes) -> None:
    said = list[str]()
    capture_time(written(data, "input.jpg"), said.append)
    assert all(len(one) <= LONGEST_SENTENCE for one in said)


def read_tlog(data: bytes) -> None:
    with one_sentence():
        read_recording(written(data, "input.tlog"), LinkSettings())


def read_settings(data: bytes) -> None:
    with one_sentence():
        load_config(written(data, "input.yaml"))


def read_points(data: bytes) -> None:
    with one_sentence():
        read_control_points(written(data, "input.csv"))


def read_wms(data: bytes) -> None:
    asked = lower_names(dict(parse_qsl(data.decode("utf-8", "surrogateescape"), keep_blank_values=True)))
    try:
        grid = map_request(asked).grid
    except WmsFault:
        return
    tile_in(grid)
    places = strip_of(grid, 0, 1).places(np.array([0.0, grid.width]), np.array([0.0, 1.0]))
    assert np.isfinite(places).all()


def read_exports(data: bytes) -> None:
    """A find's texts, whatever they are, in all that is exported of it: KML, CSV and GeoJSON stay what they are."""
    finds = seeds.finds_of(data[: len(data) // 2 * 2].decode("utf-16-le", "surrogatepass"))
    marks = ElementTree.fromstring(as_kml(finds, "a flight")).findall(".//{*}Placemark")
    assert len(marks) == len(finds)
    rows = list(csv.reader(io.StringIO(as_csv(finds))))
    assert len(rows) == len(finds) + 1
    assert len({len(row) for row in rows}) == 1
    assert len(json.loads(as_geojson(finds, "a flight"))["features"]) == len(finds)


def read_checkpoint(data: bytes) -> None:
    """The payload; what stands in front of it is made to fit."""
    name = bytes(16)
    digest = blake2b(data, digest_size=16).digest()
    head = checkpoint.HEAD.pack(checkpoint.FORMAT, checkpoint.program_digest(), digest, name, len(name))
    written(checkpoint.MAGIC + head + data, checkpoint.NAME)
    written(name, checkpoint.VALUES_NAME)
    kept = checkpoint.Checkpoints(folder(), read_only=True)
    try:
        kept.load()
    finally:
        kept.close()


def read_onnx(data: bytes) -> None:
    with suppress(ValueError):
        declared_inputs(data)


TARGETS = {
    "tiff": Target(read_tiff, seeds.tiffs),
    "jpeg": Target(read_jpeg, seeds.jpegs),
    "exif": Target(read_exif, seeds.exifs),
    "tlog": Target(read_tlog, seeds.tlogs, 16_384),
    "wms": Target(read_wms, seeds.wms_questions),
    "kml": Target(read_exports, seeds.texts, 512),
    "yaml": Target(read_settings, seeds.settings, 10_240),
    "checkpoint": Target(read_checkpoint, seeds.checkpoints),
    "points": Target(read_points, seeds.control_points),
    "onnx": Target(read_onnx, seeds.models),
}
