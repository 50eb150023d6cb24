"""Flights whose frames are drawn: cut out of one painted ground at known poses, with things laid on it for each frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.messages import content_hash
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, IslandEntry, mosaic_document
from gcs_mosaic.store.records import Accounts, FrameState
from tests.factories import frame

LENS = Camera(320, 240, focal=1.4, k1=-0.03)
SIDE = 1000  # canvas units of the ground, from -200 on
CORNER = -200

Things = Callable[[ImageBGR], None]  # lays something on the ground


@dataclass(frozen=True, slots=True)
class Drawn:
    """A frame: where it lies, how much light there was, what lay on the ground."""

    name: str
    pose: Pose
    light: float = 1.0
    things: Things = lambda ground: None
    modified: float = 1e9


def ground(seed: int = 1) -> ImageBGR:
    """(SIDE, SIDE, 3): texture of several scales."""
    random = np.random.default_rng(seed)
    grey = np.full((SIDE, SIDE), 110.0, np.float32)
    for coarse, strength in ((64, 30), (16, 14), (4, 6)):
        noise = random.normal(0, strength, (SIDE // coarse + 2,) * 2).astype(np.float32)
        grey += cv2.resize(noise, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    return np.repeat(np.clip(grey, 20, 200).astype(np.uint8)[..., None], 3, axis=2)


def laid_at(x: float, y: float, half: float = 4, colour: tuple[int, int, int] = (240, 240, 240)) -> Things:
    """A square about a canvas place."""

    def lay(picture: ImageBGR) -> None:
        left, top, right, bottom = (round(at - CORNER) for at in (x - half, y - half, x + half, y + half))
        picture[top:bottom, left:right] = colour

    return lay


def photographed(picture: ImageBGR, pose: Pose, light: float, noise: int) -> ImageBGR:
    """What a camera at a pose sees of the ground, with some noise."""
    x, y = np.meshgrid(np.arange(LENS.width), np.arange(LENS.height))
    places = canvas_from_pixels(pose, LENS, np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)) - CORNER - 0.5
    at = places.reshape(LENS.height, LENS.width, 2).astype(np.float32)
    seen = cv2.remap(picture, at, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    grain = np.random.default_rng(noise).normal(0, 1.5, seen.shape)
    return np.asarray(np.clip(seen * light + grain, 0, 255), np.uint8)


def drawn_flight(root: Path, frames: Sequence[Drawn], off: float = 0.0) -> Path:
    """Its folder, with ledger and originals; `off`: canvas units that frames are told to lie beside where they do, either way."""
    (root / "frames").mkdir(parents=True)
    bare = ground()
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_island(0)
        for number, one in enumerate(frames):
            picture = bare.copy()
            one.things(picture)
            data = cv2.imencode(".png", photographed(picture, one.pose, one.light, number))[1].tobytes()
            kept = f"frames/{number}.png"
            (root / kept).write_bytes(data)
            beside = off * (1 if number % 2 else -1)
            lies = replace(one.pose, x=one.pose.x + beside, y=one.pose.y - beside)
            ledger.record_frame(frame(one.name, content_hash=content_hash(data), modified=one.modified + number))
            ledger.record_original(one.name, kept)
            ledger.record_size(one.name, LENS.width, LENS.height)
            ledger.settle_frame(one.name, FrameState.PLACED)
            item = RenderItem(name=one.name, order=number, island=0, pose=lies, camera=LENS, level=16)
            ledger.record_painted(item)
    xs, ys = zip(*((one.pose.x, one.pose.y) for one in frames), strict=True)
    bounds = min(xs) - LENS.width / 2, min(ys) - LENS.height / 2, max(xs) + LENS.width / 2, max(ys) + LENS.height / 2
    entry = IslandEntry(id=0, bounds=bounds, minzoom=12, maxzoom=16, frames=len(frames))
    told = Contents(flight="drawn", updated_utc=1.0, islands=[entry], accounts=Accounts(), frames=FrameNews())
    write_json(root / "mosaic.json", mosaic_document(told, 1))
    return root


def as_merged(root: Path) -> Path:
    """The folder as `gcs-mosaic merge` leaves it."""
    write_json(root / "progress.json", {"format": 1, "command": "merge", "state": "ended"})
    return root
