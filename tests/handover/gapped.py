"""A flight with a hole: frames of 400 x 300 units each 150 across and 120 along, but for six in the middle; laid by four pins."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, IslandEntry, mosaic_document
from gcs_mosaic.store.records import Accounts, Estimate, FlightRecord
from tests.factories import frame
from tests.notes.written_pins import write_pins

LENS = Camera(400, 300, focal=1.4)
METRES = 0.1  # of a canvas unit
PLANE = LocalPlane(8.5456, 47.3977)
HOLE = ((350.0, 270.0), (550.0, 330.0))  # unseen, two corners on the canvas
HEIGHT_M = LENS.focal_px * METRES


def gapped_flight(root: Path, focal_deviation: float | None = 0.05, *, pinned: bool = True) -> Path:
    """Its folder; `focal_deviation`: what is stated of the lens."""
    root.mkdir()
    places = [(x, y) for x in range(0, 901, 150) for y in range(0, 601, 120) if not is_missing(x, y)]
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name="gapped", started_utc=1.0))
        ledger.record_island(0)
        for number, (x, y) in enumerate(places):
            name, pose = f"{number}.jpg", Pose(float(x), float(y))
            ledger.record_frame(frame(name, modified=1000.0 + number))
            ledger.record_painted(RenderItem(name=name, order=number, island=0, pose=pose, camera=LENS, level=16))
            ledger.record_estimates([estimate(name, pose, focal_deviation)])
    entry = IslandEntry(id=0, bounds=(-200.0, -150.0, 1100.0, 750.0), minzoom=12, maxzoom=16, frames=len(places))
    told = Contents(flight="gapped", updated_utc=1.0, islands=[entry], accounts=Accounts(), frames=FrameNews())
    write_json(root / "mosaic.json", mosaic_document(told, 1))
    if pinned:
        write_pins(root, [(x, y, *earth(x, y)) for x, y in ((0, 0), (900, 0), (0, 600), (900, 600))])
    return root


def is_missing(x: float, y: float) -> bool:
    return abs(x - 450) <= 150 and abs(y - 300) <= 60


def estimate(name: str, pose: Pose, focal_deviation: float | None) -> Estimate:
    numbers = {"inliers": 99, "residual_px": 0.5, "neighbours": 3, "hops": 1, "corner_deviation_px": 0.1}
    return Estimate(
        name=name,
        island=0,
        pose=pose,
        camera=LENS,
        focal_log_deviation=focal_deviation,
        **numbers,  # type: ignore[arg-type]
    )


def earth(x: float, y: float) -> tuple[float, float]:
    """Longitude and latitude of a canvas place; north is up."""
    longitude, latitude = PLANE.places(np.array([x * METRES, -y * METRES])).tolist()
    return longitude, latitude


def canvas(longitude: float, latitude: float) -> tuple[float, float]:
    """Inverse of `earth`."""
    east, north = PLANE.spots(np.array([longitude, latitude])).tolist()
    return east / METRES, -north / METRES
