"""Small events, frames and painted frames for tests of the output folder."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.messages import CaptureResult, Frame, Position, Source, TriggerEvent, content_hash
from gcs_mosaic.render.light_field import COLUMNS, ROWS, LightField
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import Estimate
from tests.factories import frame, trigger_event

# A frame's pixels to those of one that was taken a little beside it.
NEARLY_THE_SAME = ((1.0, 0.01, 2.5), (-0.01, 1.0, -0.1), (1e-7, 0.0, 1.0))


def an_event(sequence: int = 7, position: Position | None = None, file_hint: str | None = None) -> TriggerEvent:
    return trigger_event(
        sequence,
        12.25,
        component=100,
        camera=2,
        source=Source.IMAGE_CAPTURED_BY_CAMERA,
        source_time=0.1,
        clock="boot",
        utc=1.7e9 + 0.1,
        result=CaptureResult.TAKEN,
        file_hint=file_hint,
        position=position,
    )


def a_frame(name: str = "a.jpg", folder: Path = Path(), data: bytes = b"picture") -> Frame:
    known = {"path": folder / name, "content_hash": content_hash(data), "size": len(data), "modified": 1.7e9}
    return frame(name, 3.5, **known)


def written_frame(folder: Path, name: str = "a.jpg", data: bytes = b"picture") -> Frame:
    """A frame whose file really is there."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return a_frame(name, folder, data)


def an_estimate(pose: Pose, residual_px: float | None = 1.0, corner_deviation_px: float | None = 0.25) -> Estimate:
    """Of the frame a.jpg."""
    return Estimate(
        name="a.jpg",
        island=0,
        pose=pose,
        camera=Camera(4, 3),
        inliers=9,
        residual_px=residual_px,
        neighbours=2,
        hops=1,
        corner_deviation_px=corner_deviation_px,
    )


def a_painted(name: str = "a.jpg", order: int = 0, island: int = 0, focal: float = 1.4) -> RenderItem:
    return RenderItem(
        name=name,
        order=order,
        island=island,
        pose=Pose(0.1 + order, -1 / 3, 0.01, 3.1, -0.02, 1e-17),
        camera=Camera(4000, 3000, focal, -0.031),
        gain=(1.0, 0.97, 1.03),
        vignetting=((0.1, -0.2, 0.03), (0.0, -0.1, 0.0), (0.0, -0.3, 0.1)),
        light=LightField(bytes(range(COLUMNS * ROWS * 3))),
        dead=DeadBorder(0, 12, 1, 13),
        still=StillMask(2, 9, bytes([3, 128, 192])),
        area=PictureArea(3, 4, bytes([254, 48])),
        level=16,
    )


def forget_painted(ledger: Ledger, name: str) -> None:
    """As if the frame had never been painted."""
    ledger.write("DELETE FROM painted WHERE frame = (SELECT id FROM frames WHERE name = ?)", name)
