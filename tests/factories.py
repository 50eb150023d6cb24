"""What many tests begin with; whatever matters to a test is named by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs_mosaic.messages import CaptureResult, Frame, Source, TriggerEvent, content_hash
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.graph.placement import Placement


def trigger_event(sequence: int | None = None, received: float = 0.0, **fields: Any) -> TriggerEvent:
    """An autopilot's CAMERA_TRIGGER without a time of its own, but for these fields."""
    plain = TriggerEvent(
        vehicle=1,
        component=1,
        camera=0,
        source=Source.CAMERA_TRIGGER,
        sequence=sequence,
        received=received,
        source_time=None,
        clock="none",
        utc=None,
        result=CaptureResult.UNKNOWN,
        file_hint=None,
        position=None,
    )
    return replace(plain, **fields)


def frame(name: str, received: float = 0.0, **fields: Any) -> Frame:
    """A frame of a file that nobody reads; its hash is its name. What follows a # tells it from others of that file."""
    path = Path(name.partition("#")[0])
    plain = Frame(name=name, path=path, content_hash=name, size=1, received=received, modified=0.0)
    return replace(plain, **fields)


def placement(name: str, pose: Pose, camera: Camera, **fields: Any) -> Placement:
    """A frame that lies well, on the first island and with no neighbours, but for these fields."""
    plain = Placement(
        name=name,
        island=0,
        pose=pose,
        camera=camera,
        relief=None,
        inliers=99,
        residual_px=0.5,
        neighbours=(),
        hops=1,
        corner_deviation_px=0.1,
    )
    return replace(plain, **fields)


def taken(folder: Path, name: str, data: bytes | None = None, picture: str | None = None) -> Frame:
    """A frame whose file is in the folder; its content is its name unless `data` is given."""
    path = folder / name
    path.write_bytes(data or name.encode())
    digest = content_hash(path.read_bytes())
    return replace(frame(name), path=path, content_hash=digest, size=path.stat().st_size, picture=picture)
