"""Conversion between the ledger's rows and records."""

from __future__ import annotations

import json
import math
import operator
import sqlite3
import struct
import zlib
from dataclasses import asdict

import numpy as np

from gcs_mosaic.messages import CaptureResult, Position, RecordedPosition, Source, Teller, TriggerEvent
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.render.display import PLAIN, Display
from gcs_mosaic.render.light_field import COLUMNS, ROWS, LightField
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import FINEST_LEVEL
from gcs_mosaic.render.vignetting import FLAT, Vignetting
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.graph.placement import Homography
from gcs_mosaic.store.records import (
    CoveredRecord,
    Estimate,
    EventRecord,
    EventState,
    FlightRecord,
    FrameRecord,
    FrameState,
    PositionRecord,
    ReportedPosition,
)
from gcs_mosaic.store.stored_text import restored, stored

EVENT_COLUMNS = (
    "vehicle, component, camera, source, sequence, received, source_time, clock, utc, result, file_hint, "
    "latitude_deg, longitude_deg, altitude_m"
)
POSE_COLUMNS = "x, y, log_gsd, yaw, pitch, roll"
LENS_COLUMNS = "focal, k1, k2, shift_x, shift_y, fisheye"
RELIEF_COLUMNS = "relief_columns, relief_rows, relief_shifts"
LOOK_COLUMNS = "gain, vignetting, display, dead_border, overlay, light, picture_area"
BLOCKS_SIZE = struct.Struct("<HH")  # rows and columns
# What a row may say; it may have been written by somebody else, and what follows from it is computed.
MOST_BLOCK_BYTES = 1 << 20  # bytes of bits: 8 million blocks
MOST_PIXELS = 400_000_000  # of a frame, as `frames.integrity` takes them
MOST_LOG_GSD = 50.0  # natural logarithm: far beyond what a canvas has room for
SHIFT_BYTES = 8  # two numbers of four bytes at a node
SUPPORT_COLUMNS = "inliers, residual_px, neighbours, hops, corner_deviation_px"


def name_of(row: sqlite3.Row) -> str:
    """The frame name in the row's `name` column. Raises ValueError."""
    name = restored(row["name"])
    if not isinstance(name, str):
        raise ValueError(f"not the name of a frame: {name!r:.40}")
    return name


def event_row(event: TriggerEvent) -> tuple[object, ...]:
    """Values for EVENT_COLUMNS."""
    place = event.position
    position = (place.latitude_deg, place.longitude_deg, place.altitude_m) if place else (None, None, None)
    return (
        *(event.vehicle, event.component, event.camera, int(event.source), event.sequence, event.received),
        *(event.source_time, event.clock, event.utc, event.result.value, stored(event.file_hint)),
        *position,
    )


def event_of(row: sqlite3.Row) -> TriggerEvent:
    return TriggerEvent(
        vehicle=row["vehicle"],
        component=row["component"],
        camera=row["camera"],
        source=Source(row["source"]),
        sequence=row["sequence"],
        received=row["received"],
        source_time=row["source_time"],
        clock=row["clock"],
        utc=row["utc"],
        result=CaptureResult(row["result"]),
        file_hint=restored(row["file_hint"]),
        position=position_of(row),
    )


def position_of(row: sqlite3.Row) -> Position | None:
    if row["latitude_deg"] is None or row["longitude_deg"] is None:
        return None
    return Position(latitude_deg=row["latitude_deg"], longitude_deg=row["longitude_deg"], altitude_m=row["altitude_m"])


def reported_position_of(row: sqlite3.Row) -> ReportedPosition:
    """Of an event with a position; `taken` is the frame's number."""
    event = event_of(row)
    assert event.position is not None, "only such events are asked for"
    return ReportedPosition(
        frame=row["taken"],
        teller=event.teller,
        received=event.received,
        source_time=None if event.clock == "none" else event.source_time,
        position=event.position,
    )


def recorded_of(row: sqlite3.Row) -> RecordedPosition:
    """Of a row of the table `recorded`."""
    position = position_of(row)
    if position is None:
        raise ValueError("a row without a position")
    return RecordedPosition(position=position, time_s=float(row["time_s"]), told_by=row["told_by"])


def recorded_position_of(row: sqlite3.Row) -> ReportedPosition:
    recorded = recorded_of(row)
    return ReportedPosition(
        frame=row["frame"],
        teller=Teller(recorded.told_by, 0, 0, Source.IMAGE_CAPTURED_BY_CAMERA),
        received=recorded.time_s,
        source_time=recorded.time_s,
        position=recorded.position,
    )


def event_record_of(row: sqlite3.Row) -> EventRecord:
    return EventRecord(
        id=row["id"],
        event=event_of(row),
        state=EventState(row["state"]),
        duplicate_of=row["duplicate_of"],
        frame=restored(row["frame_name"]),
    )


def frame_record_of(row: sqlite3.Row) -> FrameRecord:
    """Raises ValueError and TypeError for what is no frame."""
    counts = row["size"], row["width"], row["height"]
    times = row["received"], row["modified"]
    if any(value is not None and not (isinstance(value, int) and value >= 0) for value in counts):
        raise ValueError(f"not the size of a frame: {counts}")
    if any(value is not None and not math.isfinite(value) for value in times):
        raise ValueError(f"not the times of a frame: {times}")
    return FrameRecord(
        name=name_of(row),
        state=FrameState(row["state"]),
        reason=row["reason"],
        had_event=bool(row["had_event"]),
        original=restored(row["original"]),
        content_hash=row["content_hash"],
        size=row["size"],
        width=row["width"],
        height=row["height"],
        received=row["received"],
        modified=row["modified"],
        sharpness=row["sharpness"] if "sharpness" in row.keys() else None,  # noqa: SIM118 -- a row is no mapping
        vehicle=vehicle_of(row),
    )


def vehicle_of(row: sqlite3.Row) -> int | None:
    """The aircraft of a frame; None also for ledgers older than this column."""
    return row["vehicle"] if "vehicle" in row.keys() else None  # noqa: SIM118 -- a row is no mapping


def pose_row(pose: Pose) -> tuple[float, ...]:
    """Values for POSE_COLUMNS. Raises ValueError for NaN and infinity: such a pose must not reach the ledger."""
    values = (pose.x, pose.y, pose.log_gsd, pose.yaw, pose.pitch, pose.roll)
    if not all(math.isfinite(value) for value in values):
        raise ValueError(f"not a pose: {pose}")
    return tuple(float(value) for value in values)


def support_row(one: Estimate) -> tuple[float | None, ...]:
    """Values for SUPPORT_COLUMNS."""
    counts = int(one.inliers), one.residual_px, int(one.neighbours), int(one.hops)
    return (*counts, one.corner_deviation_px)


def pose_of(row: sqlite3.Row) -> Pose:
    """Raises ValueError and TypeError for what is no pose."""
    values = row["x"], row["y"], row["log_gsd"], row["yaw"], row["pitch"], row["roll"]
    if not all(map(math.isfinite, values)) or abs(values[2]) > MOST_LOG_GSD:
        raise ValueError(f"not a pose: {values}")
    return Pose(*values)


def camera_row(camera: Camera) -> tuple[float, ...]:
    """Values for width, height and LENS_COLUMNS."""
    lens = (camera.focal, camera.k1, camera.k2, camera.shift_x, camera.shift_y)
    return (camera.width, camera.height, *(float(value) for value in lens), int(camera.fisheye))


def camera_of(row: sqlite3.Row) -> Camera:
    """Raises ValueError and TypeError for what is no camera."""
    lens = (row["focal"], row["k1"], row["k2"], row["shift_x"], row["shift_y"])
    width, height, fisheye = row["camera_width"], row["camera_height"], row["fisheye"]
    possible = width > 0 and height > 0 and width * height <= MOST_PIXELS and all(map(math.isfinite, lens))
    if not (possible and lens[0] > 0 and fisheye in (0, 1)):
        raise ValueError(f"not a camera: {width} x {height}, {lens}, {fisheye}")
    return Camera(operator.index(width), operator.index(height), *lens, fisheye=bool(fisheye))


def level_of(row: sqlite3.Row) -> int:
    """Of tiles. Raises ValueError and TypeError."""
    level = operator.index(row["level"])
    if not 0 <= level <= FINEST_LEVEL:
        raise ValueError(f"not a level of tiles: {level}")
    return level


def relief_row(relief: ReliefDisplacement | None) -> tuple[object, ...]:
    """Values for RELIEF_COLUMNS."""
    return (None, None, None) if relief is None else (relief.columns, relief.rows, relief.shifts)


def relief_of(row: sqlite3.Row) -> ReliefDisplacement | None:
    if row["relief_shifts"] is None:
        return None
    columns, rows, shifts = row["relief_columns"], row["relief_rows"], row["relief_shifts"]
    if min(columns, rows) < 2 or len(shifts) != columns * rows * SHIFT_BYTES:
        raise ValueError(f"not shifts of {columns} x {rows} nodes: {len(shifts)} bytes")
    return ReliefDisplacement(operator.index(columns), operator.index(rows), bytes(shifts))


def look_row(painted: RenderItem) -> tuple[object, ...]:
    """Values for LOOK_COLUMNS: gains and vignetting as 64-bit floats, display and dead border as JSON."""
    gain, vignetting = (np.array(values, dtype="<f8").tobytes() for values in (painted.gain, painted.vignetting))
    dead = json.dumps([int(lines) for lines in painted.dead])
    light = None if painted.light is None else painted.light.logs
    masks = _blocks_row(painted.still), _blocks_row(painted.area)
    return gain, vignetting, json.dumps(asdict(painted.display)), dead, masks[0], light, masks[1]


def vignetting_of(row: sqlite3.Row) -> Vignetting:
    """Also for ledgers older than this column."""
    stored = row["vignetting"] if "vignetting" in row.keys() else None  # noqa: SIM118 -- `in` on a row searches its values
    if stored is None:
        return FLAT
    values = np.frombuffer(stored, "<f8").tolist()
    if len(values) == 2:  # older format: one curve of even powers for all bands
        return ((0.0, *values),) * len(gain_of(row)) if any(values) else FLAT
    return tuple(zip(*(values[k::3] for k in range(3)), strict=True))


def light_of(row: sqlite3.Row) -> LightField | None:
    """Also for ledgers older than this column. Raises ValueError."""
    stored = row["light"] if "light" in row.keys() else None  # noqa: SIM118 -- `in` on a row searches its values
    if stored is None:
        return None
    if len(stored) != COLUMNS * ROWS * len(gain_of(row)):
        raise ValueError(f"not a light field of {COLUMNS} x {ROWS} nodes: {len(stored)} bytes")
    return LightField(bytes(stored))


def dead_border_of(row: sqlite3.Row) -> DeadBorder:
    """Also for ledgers older than this column."""
    stored = row["dead_border"] if "dead_border" in row.keys() else None  # noqa: SIM118 -- `in` on a row searches its values
    return NO_BORDER if stored is None else DeadBorder(*json.loads(stored))


def _blocks_row(mask: StillMask | PictureArea | None) -> bytes | None:
    return None if mask is None else zlib.compress(BLOCKS_SIZE.pack(mask.rows, mask.columns) + mask.bits)


def overlay_of(row: sqlite3.Row) -> StillMask | None:
    """Also for ledgers older than this column."""
    stored = row["overlay"] if "overlay" in row.keys() else None  # noqa: SIM118 -- `in` on a row searches its values
    return None if stored is None else StillMask(*_blocks_of(stored, "an overlay"))


def picture_area_of(row: sqlite3.Row) -> PictureArea | None:
    """Also for ledgers older than this column."""
    stored = row["picture_area"] if "picture_area" in row.keys() else None  # noqa: SIM118 -- as above
    return None if stored is None else PictureArea(*_blocks_of(stored, "the area of a picture"))


def _blocks_of(stored: bytes, what: str) -> tuple[int, int, bytes]:
    """Rows, columns and bits. Raises ValueError."""
    data = zlib.decompressobj().decompress(stored, MOST_BLOCK_BYTES)
    if len(data) < BLOCKS_SIZE.size:
        raise ValueError(f"not {what}: {len(data)} bytes")
    rows, columns = BLOCKS_SIZE.unpack_from(data)
    bits = data[BLOCKS_SIZE.size :]
    if len(bits) != -(-rows * columns // 8) or not bits:
        raise ValueError(f"not {what} of {rows} x {columns} blocks: {len(bits)} bytes")
    return rows, columns, bits


def gain_of(row: sqlite3.Row) -> tuple[float, ...]:
    if "gain" in row.keys():  # noqa: SIM118 -- `in` on a row searches its values
        return tuple(np.frombuffer(row["gain"], dtype="<f8").tolist())
    return row["gain_b"], row["gain_g"], row["gain_r"]  # version 2


def flight_of(row: sqlite3.Row) -> FlightRecord:
    """Raises ValueError and TypeError."""
    if not isinstance(row["name"], str) or not math.isfinite(row["started_utc"]):
        raise ValueError("a flight without a name or a beginning")
    return FlightRecord(name=row["name"], started_utc=row["started_utc"], canvas=canvas_of(row))


def canvas_of(row: sqlite3.Row) -> CompositorSettings:
    if "canvas" in row.keys():  # noqa: SIM118
        return CompositorSettings(**json.loads(row["canvas"]))
    return CompositorSettings(blend="edge")


def display_of(row: sqlite3.Row) -> Display:
    if "display" not in row.keys():  # noqa: SIM118
        return PLAIN
    blue, green, red = (values := json.loads(row["display"]))["shown"]
    light = values.get("factor", 1.0), values.get("gamma", 1.0)
    knots = tuple(tuple((at, level) for at, level in band) for band in values.get("knots", ()))
    step = tuple(values.get("scale", ())), tuple(values.get("offset", ()))
    return Display((blue, green, red), tuple(values["black"]), tuple(values["white"]), *light, knots, *step)


def homography_row(homography: Homography | None) -> bytes | None:
    """Nine 8-byte floats."""
    return None if homography is None else np.array(homography, dtype="<f8").tobytes()


def homography_of(row: sqlite3.Row) -> Homography | None:
    """None also for ledgers older than this column."""
    stored = row["homography"] if "homography" in row.keys() else None  # noqa: SIM118 -- `in` on a row searches its values
    return None if stored is None else nine_numbers(stored)


def nine_numbers(stored: bytes) -> Homography:
    """Inverse of `homography_row`."""
    return tuple(map(tuple, np.frombuffer(stored, "<f8").reshape(3, 3).tolist()))


def covered_of(row: sqlite3.Row) -> CoveredRecord:
    return CoveredRecord(
        name=name_of(row),
        by=restored(row["keyframe"]) or "",
        by_from_frame=nine_numbers(row["keyframe_from_frame"]),
        width=row["width"],
        height=row["height"],
        vehicle=vehicle_of(row),
    )


def position_record_of(row: sqlite3.Row) -> PositionRecord:
    return PositionRecord(
        number=row["frame"],
        name=name_of(row),
        island=row["island"],
        order=row["order"],
        level=level_of(row),
        pose=pose_of(row),
        camera=camera_of(row),
        modified=row["modified"],
        original=restored(row["original"]),
        content_hash=row["content_hash"],
        corner_deviation_px=row["deviation"],
        sharpness=row["sharpness"],
        vehicle=vehicle_of(row),
    )


def painted_of(row: sqlite3.Row) -> RenderItem:
    return RenderItem(
        name=name_of(row),
        order=row["order"],
        island=row["island"],
        pose=pose_of(row),
        camera=camera_of(row),
        relief=relief_of(row),
        gain=gain_of(row),
        vignetting=vignetting_of(row),
        light=light_of(row),
        display=display_of(row),
        dead=dead_border_of(row),
        still=overlay_of(row),
        area=picture_area_of(row),
        level=level_of(row),
    )


def estimate_of(row: sqlite3.Row) -> Estimate:
    return Estimate(
        name=name_of(row),
        island=row["island"],
        pose=pose_of(row),
        camera=camera_of(row),
        relief=relief_of(row),
        inliers=row["inliers"],
        residual_px=row["residual_px"],
        neighbours=row["neighbours"],
        hops=row["hops"],
        corner_deviation_px=row["corner_deviation_px"],
        homography=homography_of(row),
        vehicle=vehicle_of(row),
        focal_log_deviation=row["focal_log_deviation"] if "focal_log_deviation" in row.keys() else None,  # noqa: SIM118
    )
