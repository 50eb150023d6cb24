"""An output folder with tiles of one colour each, for tests of the page and its server."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.messages import LinkReport, SourceReport
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, IslandEntry, Manifest
from gcs_mosaic.store.records import Accounts, CoveredRecord, Estimate, NoticeRecord
from gcs_mosaic.store.status import LastFrame, Status, status_document
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount

MIDDLE = 1 << 15  # the tile of level 16 whose top left corner is the canvas' origin (but for half a pixel)
RED, GREEN, BLUE = (0, 0, 255), (0, 200, 0), (255, 0, 0)


class SmallFlight:
    """Writes what a daemon writes, two tiles wide and high at level 16."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.manifest = Manifest(root)
        self.estimates: list[Estimate] = []
        self.covered: list[CoveredRecord] = []
        self.rejected = 0
        self.islands = [IslandEntry(id=0, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=1)]

    def paint(self, tile: Tile, colour: tuple[int, int, int], island: int = 0) -> None:
        path = self.root / "tiles" / str(island) / str(tile.z) / str(tile.x) / f"{tile.y}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        _, data = cv2.imencode(".jpg", np.full((256, 256, 3), colour, np.uint8))
        write_beside(path, data.tobytes())

    def place(self, name: str, x: float, y: float, island: int = 0, vehicle: int | None = None) -> None:
        estimate = Estimate(
            name=name,
            island=island,
            pose=Pose(x, y),
            camera=Camera(240, 180),
            inliers=99,
            residual_px=0.5,
            neighbours=3,
            hops=1,
            corner_deviation_px=0.4,
            vehicle=vehicle,
        )
        self.estimates.append(estimate)

    def cover(self, name: str, by: str, x: float, y: float) -> None:
        """A frame that lies so many pixels beside its keyframe."""
        shifted = ((1.0, 0.0, x), (0.0, 1.0, y), (0.0, 0.0, 1.0))
        self.covered.append(CoveredRecord(name=name, by=by, by_from_frame=shifted, width=240, height=180))

    def write(self, newest: str | None = None) -> int:
        """Tell all that is here of the frames; returns the revision. `newest`: not the last of them."""
        frames = FrameAccount(placed=len(self.estimates), rejected=self.rejected)
        accounts = Accounts(frames=frames, events=EventAccount(matched=2, missing=1))
        if newest is None and self.estimates:
            newest = (self.covered or self.estimates)[-1].name
        newest_of = {one.vehicle: one.name for one in self.estimates if one.vehicle is not None}
        contents = Contents(
            flight="small",
            updated_utc=time.time(),
            islands=self.islands,
            accounts=accounts,
            frames=FrameNews(estimates=self.estimates, covered=self.covered, newest=newest, newest_of=newest_of),
        )
        return self.manifest.write(contents)

    def status(self, **changes: object) -> None:
        now = time.time()
        status = Status(
            flight="small",
            state="flying",
            updated_utc=now,
            started_utc=now - 60,
            mavlink=(LinkReport(address="udp:14550", state="heard", last_heard_utc=now),),
            watch=SourceReport(kind="folder", name="frames", state="watching"),
            last_frame=LastFrame(name="b.jpg", outcome="placed", island=0, utc=now - 1, seconds_to_tile=0.5),
            accounts=Accounts(frames=FrameAccount(placed=54, waiting=2), events=EventAccount(matched=53, missing=1)),
            notices=(NoticeRecord(utc=now - 5, source="link", level="info", text="udp:14550: vehicle 1 is heard"),),
        )
        write_json(self.root / "status.json", status_document(replace(status, **changes)))  # type: ignore[arg-type]
