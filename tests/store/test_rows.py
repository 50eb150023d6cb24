"""What a row of a ledger may say, which somebody else may have written."""

from __future__ import annotations

import json
import math
import sqlite3
import struct
import zlib
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.messages import Position, Source
from gcs_mosaic.render.display import PLAIN
from gcs_mosaic.render.light_field import LightField
from gcs_mosaic.render.tile_grid import FINEST_LEVEL
from gcs_mosaic.render.vignetting import FLAT
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.store import rows
from gcs_mosaic.store.rows import MOST_LOG_GSD, MOST_PIXELS


def row(**values: Any) -> sqlite3.Row:
    with sqlite3.connect(":memory:") as connection:
        connection.row_factory = sqlite3.Row
        columns = ", ".join(f'? AS "{name}"' for name in values)
        found: sqlite3.Row = connection.execute(f"SELECT {columns}", [*values.values()]).fetchone()
    connection.close()
    return found


FRAME: dict[str, Any] = {
    "name": "a.jpg", "state": "placed", "reason": None, "had_event": 1, "original": "frames/a.jpg", "content_hash": "x",
    "size": 5, "width": 40, "height": 30, "received": 1.5, "modified": 2.5, "sharpness": 0.5, "vehicle": 3,
}  # fmt: skip


def test_a_frame_is_read_as_it_was_written() -> None:
    found = rows.frame_record_of(row(**FRAME))
    assert (found.name, found.state.value, found.had_event, found.size) == ("a.jpg", "placed", True, 5)
    assert (found.width, found.height, found.received, found.modified) == (40, 30, 1.5, 2.5)
    assert (found.sharpness, found.vehicle, found.original) == (0.5, 3, "frames/a.jpg")
    older = {name: value for name, value in FRAME.items() if name not in ("sharpness", "vehicle")}
    found = rows.frame_record_of(row(**older, **{}))
    assert (found.sharpness, found.vehicle) == (None, None)
    unknown = dict.fromkeys(("size", "width", "height", "received", "modified"))
    assert rows.frame_record_of(row(**FRAME | unknown)).size is None
    assert rows.frame_record_of(row(**FRAME | {"size": 0})).size == 0


@pytest.mark.parametrize(
    "change",
    [
        {"size": -1}, {"width": "40"}, {"height": 3.5}, {"received": math.inf}, {"modified": -math.inf}, {"name": None},
        {"name": 5}, {"state": "elsewhere"},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_no_frame_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises((ValueError, AttributeError)):
        rows.frame_record_of(row(**FRAME | change))


POSE: dict[str, Any] = {"x": 1.0, "y": 2.0, "log_gsd": 0.5, "yaw": 0.1, "pitch": 0.2, "roll": 0.3}
CAMERA: dict[str, Any] = {
    "camera_width": 400, "camera_height": 300, "focal": 1.5, "k1": 0.01, "k2": 0.02, "shift_x": 0.03, "shift_y": 0.04,
    "fisheye": 1,
}  # fmt: skip


def test_a_pose_and_a_camera_are_read_as_they_were_written() -> None:
    pose, camera = Pose(1.0, 2.0, 0.5, 0.1, 0.2, 0.3), Camera(400, 300, 1.5, 0.01, 0.02, 0.03, 0.04, fisheye=True)
    assert rows.pose_of(row(**POSE)) == pose
    assert rows.pose_row(pose) == tuple(POSE.values())
    assert rows.camera_of(row(**CAMERA)) == camera
    assert rows.camera_row(camera) == tuple(CAMERA.values())
    for sign in (-1, 1):
        assert rows.pose_of(row(**POSE | {"log_gsd": sign * MOST_LOG_GSD})).log_gsd == sign * MOST_LOG_GSD
    assert rows.camera_of(row(**CAMERA | {"camera_width": MOST_PIXELS, "camera_height": 1})).width == MOST_PIXELS


@pytest.mark.parametrize("name", POSE)
def test_a_pose_that_is_not_finite_is_neither_read_nor_written(name: str) -> None:
    with pytest.raises(ValueError, match="not a pose"):
        rows.pose_of(row(**POSE | {name: math.inf}))
    with pytest.raises(ValueError, match="not a pose"):
        rows.pose_row(Pose(**POSE | {name: math.nan}))


@pytest.mark.parametrize(
    "change",
    [
        {"camera_width": 0}, {"camera_height": 0}, {"camera_width": -4, "camera_height": -4}, {"focal": 0.0}, {"focal": -1.0},
        {"camera_width": MOST_PIXELS + 1, "camera_height": 1}, {"k1": math.inf}, {"shift_y": -math.inf},
        {"camera_width": 400.5}, {"fisheye": 2},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_no_camera_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises((ValueError, TypeError)):
        rows.camera_of(row(**CAMERA | change))


def test_a_log_gsd_beyond_any_canvas_is_refused() -> None:
    for sign in (-1, 1):
        with pytest.raises(ValueError, match="not a pose"):
            rows.pose_of(row(**POSE | {"log_gsd": sign * (MOST_LOG_GSD + 0.1)}))


@pytest.mark.parametrize(("level", "is_one"), [(-1, False), (0, True), (FINEST_LEVEL, True), (FINEST_LEVEL + 1, False)])
def test_tiles_have_so_many_levels(level: int, is_one: bool) -> None:
    if is_one:
        assert rows.level_of(row(level=level)) == level
        return
    with pytest.raises(ValueError, match="not a level"):
        rows.level_of(row(level=level))


@pytest.mark.parametrize(
    ("columns", "lines", "size", "is_one"),
    [(2, 2, 32, True), (2, 3, 48, True), (1, 4, 32, False), (4, 1, 32, False), (2, 2, 31, False), (2, 2, 40, False)],
)
def test_a_relief_has_two_numbers_at_each_of_its_nodes(columns: int, lines: int, size: int, is_one: bool) -> None:
    stored = row(relief_columns=columns, relief_rows=lines, relief_shifts=bytes(size))
    if is_one:
        found = rows.relief_of(stored)
        assert found is not None
        assert (rows.relief_row(found), found.columns) == ((columns, lines, bytes(size)), columns)
        return
    with pytest.raises(ValueError, match="not shifts"):
        rows.relief_of(stored)


def test_without_relief_there_is_none() -> None:
    assert rows.relief_of(row(relief_columns=None, relief_rows=None, relief_shifts=None)) is None
    assert rows.relief_row(None) == (None, None, None)


@pytest.mark.parametrize(
    ("data", "is_one"),
    [
        (struct.pack("<HH", 3, 5) + bytes(2), True),
        (struct.pack("<HH", 4, 4) + bytes(2), True),
        (struct.pack("<HH", 3, 6) + bytes(2), False),
        (struct.pack("<HH", 3, 5) + bytes(3), False),
        (struct.pack("<HH", 3, 5)[:3], False),
    ],
)
def test_an_overlay_has_a_bit_for_each_block(data: bytes, is_one: bool) -> None:
    stored = row(overlay=zlib.compress(data))
    if is_one:
        found = rows.overlay_of(stored)
        lines, columns = struct.unpack_from("<HH", data)
        assert found == StillMask(lines, columns, data[4:])
        return
    with pytest.raises(ValueError, match="not an overlay"):
        rows.overlay_of(stored)


def test_of_an_overlay_so_much_is_unpacked_and_no_more() -> None:
    with pytest.raises(ValueError, match=str((1 << 20) - 4)):
        rows.overlay_of(row(overlay=zlib.compress(struct.pack("<HH", 60000, 60000) + bytes(1 << 22))))
    assert rows.overlay_of(row(overlay=None)) is rows.overlay_of(row(name="a")) is None


def floats(*values: float) -> bytes:
    return np.array(values, "<f8").tobytes()


def test_vignetting_of_every_version() -> None:
    gain = {"gain": floats(1.0, 2.0)}
    assert rows.vignetting_of(row(**gain, vignetting=floats(*range(6)))) == ((0, 1, 2), (3, 4, 5))
    assert rows.vignetting_of(row(**gain, vignetting=floats(0.5, 0.25))) == ((0.0, 0.5, 0.25),) * 2
    assert rows.vignetting_of(row(**gain, vignetting=floats(0.0, 0.0))) == FLAT
    assert rows.vignetting_of(row(**gain, vignetting=None)) == rows.vignetting_of(row(**gain)) == FLAT
    assert rows.gain_of(row(gain_b=1.0, gain_g=2.0, gain_r=3.0)) == (1.0, 2.0, 3.0)
    assert rows.gain_of(row(**gain)) == (1.0, 2.0)


def test_light_fields_of_every_version() -> None:
    gain, logs = {"gain": floats(1.0, 2.0)}, bytes(range(96))
    assert rows.light_of(row(**gain, light=logs)) == LightField(logs)
    assert rows.light_of(row(**gain, light=None)) is rows.light_of(row(**gain)) is None
    with pytest.raises(ValueError, match="not a light field of 8 x 6 nodes: 95 bytes"):
        rows.light_of(row(**gain, light=logs[:-1]))


def test_dead_borders_and_homographies_of_every_version() -> None:
    assert rows.dead_border_of(row(dead_border=json.dumps([1, 2, 3, 4]))) == DeadBorder(1, 2, 3, 4)
    assert rows.dead_border_of(row(dead_border=None)) == rows.dead_border_of(row(x=1)) == NO_BORDER
    nine = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
    assert rows.homography_of(row(homography=rows.homography_row(nine))) == nine
    assert rows.homography_of(row(homography=None)) is rows.homography_of(row(x=1)) is None
    assert rows.homography_row(None) is None


def test_a_flight_has_a_name_and_a_beginning() -> None:
    assert rows.flight_of(row(name="f", started_utc=5.0)).canvas.blend == "edge"
    assert rows.flight_of(row(name="f", started_utc=5.0, canvas="{}")).started_utc == 5.0
    for change in ({"name": 5}, {"started_utc": math.inf}):
        with pytest.raises(ValueError, match="without a name or a beginning"):
            rows.flight_of(row(**{"name": "f", "started_utc": 5.0} | change))


PLACE: dict[str, Any] = {"latitude_deg": 44.5, "longitude_deg": 7.0, "altitude_m": None}


def test_a_position_needs_latitude_and_longitude() -> None:
    assert rows.position_of(row(**PLACE)) == Position(latitude_deg=44.5, longitude_deg=7.0, altitude_m=None)
    for name in ("latitude_deg", "longitude_deg"):
        assert rows.position_of(row(**PLACE | {name: None})) is None
        with pytest.raises(ValueError, match="without a position"):
            rows.recorded_of(row(**PLACE | {name: None}, time_s=1.0, told_by="srt"))


def test_what_a_video_tells_is_as_if_its_camera_had_sent_it() -> None:
    found = rows.recorded_position_of(row(**PLACE, time_s=3.5, told_by="srt", frame=7))
    assert (found.frame, found.received, found.source_time) == (7, 3.5, 3.5)
    assert (found.teller.sender, found.teller.system, found.teller.component) == ("srt", 0, 0)
    assert found.teller.source is Source.IMAGE_CAPTURED_BY_CAMERA


EVENT: dict[str, Any] = {
    "vehicle": 1, "component": 100, "camera": 0, "source": int(Source.CAMERA_FEEDBACK), "sequence": 5, "received": 9.5,
    "source_time": 8.5, "clock": "boot", "utc": None, "result": "taken", "file_hint": None, "taken": 4,
}  # fmt: skip


@pytest.mark.parametrize(("clock", "source_time"), [("boot", 8.5), ("epoch", 8.5), ("none", None)])
def test_the_time_of_an_event_without_a_clock_is_none(clock: str, source_time: float | None) -> None:
    found = rows.reported_position_of(row(**EVENT | {"clock": clock}, **PLACE))
    assert (found.frame, found.source_time, found.received) == (4, source_time, 9.5)


@pytest.mark.parametrize(
    ("stored", "light"),
    [
        ({}, (1.0, 1.0, (), (), ())),
        ({"factor": 2.0, "gamma": 0.5}, (2.0, 0.5, (), (), ())),
        ({"knots": [[[0, 1], [2, 3]]], "scale": [1.5], "offset": [4]}, (1.0, 1.0, (((0, 1), (2, 3)),), (1.5,), (4,))),
    ],
)
def test_a_display_of_every_version(stored: dict[str, Any], light: tuple[Any, ...]) -> None:
    common = {"shown": [2, 1, 0], "black": [0.0], "white": [255.0]}
    found = rows.display_of(row(display=json.dumps(common | stored)))
    assert (found.shown, found.black, found.white) == ((2, 1, 0), (0.0,), (255.0,))
    assert (found.factor, found.gamma, found.knots, found.scale, found.offset) == light
    assert rows.display_of(row(x=1)) == PLAIN
