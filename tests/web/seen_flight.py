"""A flight on the page with a ledger: five by four frames with one left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import FlightRecord
from tests.factories import frame
from tests.web.small_flight import MIDDLE, RED, SmallFlight

CAMERA = Camera(240, 180, focal=1.3)
HOLE = (2, 1)
BLURRED = 0.1  # sharpness of the last frame; the others have 0.2


def seen_flight(root: Path) -> SmallFlight:
    """Its tiles, documents and ledger."""
    flight = SmallFlight(root)
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name="small", started_utc=1.0))
        ledger.record_island(0)
        for column, row in np.ndindex(5, 4):
            if (column, row) == HOLE:
                continue
            name = f"{column}{row}.jpg"
            pose = Pose(column * 200.0, row * 150.0)
            ledger.record_frame(frame(name, modified=1.7e9))
            ledger.record_size(name, CAMERA.width, CAMERA.height, BLURRED if (column, row) == (4, 3) else 0.2)
            ledger.record_painted(RenderItem(name=name, order=0, island=0, pose=pose, camera=CAMERA, level=16))
            flight.place(name, column * 200.0, row * 150.0)
    flight.paint(Tile(16, MIDDLE, MIDDLE), RED)
    flight.islands = [IslandEntry(id=0, bounds=(-256, -256, 1024, 768), minzoom=13, maxzoom=16, frames=19)]
    flight.write()
    return flight
