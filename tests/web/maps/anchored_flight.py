"""A flight whose ground is known everywhere, laid on earth by pins: what other programs see of it can be judged by its truth."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Box, Tile, tiles_over
from gcs_mosaic.stitch.arrays import AnyImage, Array
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import FlightRecord
from gcs_mosaic.store.tiles import write_tile
from tests.factories import frame
from tests.geotiles.ground import anchor, island, painted, waves
from tests.geotiles.test_earth_warp import tile_at
from tests.sure import sure
from tests.web.small_flight import SmallFlight
from tests.web.test_notes_api import Writer

BOX = (-600.0, -450.0, 600.0, 450.0)
PINNED = ((-500.0, -400.0), (500.0, -400.0), (-500.0, 400.0), (480.0, 390.0))
LONGEST = 700.0  # canvas units: of the waves on the ground
FLIGHT = "small-19700101-000001"


class AnchoredFlight:
    """Written as a daemon writes; `truth` lays it. `drawn`: the folder of one like it, whose tiles are taken over."""

    def __init__(self, root: Path, truth: Anchor | None = None, box: Box = BOX, drawn: Path | None = None) -> None:
        self.root, self.truth, self.box = root, truth or anchor(gsd_m=0.1, turned_deg=30.0), box
        self.small = SmallFlight(root)
        with Ledger(root / LEDGER_NAME) as ledger:
            ledger.begin_flight(FlightRecord(name="small", started_utc=1.0))
            ledger.record_island(0)
            ledger.record_frame(frame("a.jpg"))
            ledger.record_painted(
                RenderItem(name="a.jpg", order=0, island=0, pose=Pose(0.0, 0.0), camera=Camera(1300, 1000), level=16)
            )
        self.small.place("a.jpg", 0.0, 0.0)
        self.laid = island(box, finest=16, laid=self.truth)
        self.small.islands = [self.entry(0)]
        if drawn is None:
            self.draw()
        else:
            for kind in ("tiles", "masks"):
                shutil.copytree(drawn / kind, root / kind)
        self.small.write()

    def entry(self, id_: int, frames: int = 9, merged_into: int | None = None) -> IslandEntry:
        return IslandEntry(
            id=id_,
            bounds=self.box,
            minzoom=self.laid.coarsest,
            maxzoom=16,
            frames=frames,
            merged_into=merged_into,
        )

    def draw(self, island_: int = 0) -> None:
        """All tiles, of waves."""
        tiles = painted(LONGEST)
        for level in range(self.laid.coarsest, 17):
            for tile in tiles_over(self.box, level):
                shown = tiles(self.laid, tile)
                if shown is not None:
                    self.put(tile, shown, island_)

    def put(self, tile: Tile, shown: AnyImage, island_: int = 0) -> None:
        write_tile(self.root, island_, tile, TilePicture(shown[..., :3].copy(), shown[..., 3].copy()), 97)

    def set_pins(self, client: Writer, count: int = 4, **change: object) -> None:
        for x, y in PINNED[:count]:
            longitude, latitude = self.truth.places(np.array([x, y])).tolist()
            told = {"island": 0, "x": x, "y": y, "coordinate": f"{latitude:.12f}, {longitude:.12f}", "sigma_m": 0.05}
            status, said = client.send("POST", "/pins", {**told, "who": "Kim", **change})
            assert status == 201, said

    def colour_at(self, longitude: Array, latitude: Array) -> Array:
        """(n, 3) the true blue, green and red of places on earth."""
        return waves(self.truth.canvas(np.stack([longitude, latitude], axis=-1)), LONGEST)


def picture_of(data: bytes) -> AnyImage:
    """(h, w, 4), blue first; what has no transparency is opaque."""
    image = sure(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
    return image if image.shape[2] == 4 else np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])


def laid_at(laid: EarthIsland, level: int, x: float = 0.0, y: float = 0.0) -> tuple[int, int]:
    return tile_at(laid, level, x, y)
