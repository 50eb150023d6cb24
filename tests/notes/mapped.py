"""A flight with frames that lie somewhere, for tests of notes."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, mosaic_document
from gcs_mosaic.store.records import Accounts, FlightRecord
from tests.factories import frame
from tests.store.ledger_parts import forget_painted

LENS = Camera(400, 300, focal=1.4, k1=-0.1)


class MappedFlight:
    """Frames a.jpg and b.jpg on island 0, 300 canvas units apart, and c.jpg on island 1; each about 400 x 300 units."""

    def __init__(self, root: Path) -> None:
        self.root, self._revision = root, 0
        with Ledger(root / LEDGER_NAME) as ledger:
            ledger.begin_flight(FlightRecord(name="mapped", started_utc=1.0))
            ledger.record_island(0)
            ledger.record_island(1)
            for name in ("a.jpg", "b.jpg", "c.jpg"):
                ledger.record_frame(frame(name))
        self.paint("a.jpg", Pose(0.0, 0.0, yaw=0.2, pitch=0.05))
        self.paint("b.jpg", Pose(300.0, 0.0))
        self.paint("c.jpg", Pose(0.0, 0.0), island=1)

    def paint(self, name: str, pose: Pose, island: int = 0) -> None:
        with Ledger(self.root / LEDGER_NAME) as ledger:
            ledger.record_painted(RenderItem(name=name, order=0, island=island, pose=pose, camera=LENS, level=16))
        self._told()

    def sized(self, name: str, width: int, height: int) -> None:
        """The original is so large, whatever it is stitched at."""
        with Ledger(self.root / LEDGER_NAME) as ledger:
            ledger.record_size(name, width, height)

    def unpaint(self, name: str) -> None:
        with Ledger(self.root / LEDGER_NAME) as ledger:
            forget_painted(ledger, name)
        self._told()

    def merge(self, island: int, into: int) -> None:
        with Ledger(self.root / LEDGER_NAME) as ledger:
            ledger.merge_island(island, into)

    def _told(self) -> None:
        self._revision += 1
        told = Contents(flight="mapped", updated_utc=1.0, islands=[], accounts=Accounts(), frames=FrameNews())
        write_json(self.root / "mosaic.json", mosaic_document(told, self._revision))
