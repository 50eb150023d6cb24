"""What a tile of the map on earth costs: python -m tests.benchmarks.geo_tiles [--side 6000] [--tiles 60]

A map of noise (which compresses as badly as any photograph) with holes is written as a flight writes it, and laid on earth turned
by 30 degrees. Tiles are made one after the other on one core as a station pans: row by row at each level, the canvas' tiles
decoded as they are needed and kept within the page's bounds. Computing time of the whole (canvas tiles, warp, PNG) and of the PNG
alone, median and 95th percentile; and how much memory the process has more in the end.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Iterator
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from gcs_mosaic.geotiles.canvas_tiles import CanvasTiles, canvas_tile
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_grid import Tile, tiles_over
from gcs_mosaic.store.tiles import write_tile
from gcs_mosaic.web.maps.pictures import MapLook, encoded, encoded_tile
from gcs_mosaic.web.maps.served_map import CANVAS_BYTES
from tests.geotiles.ground import anchor, island

FINEST = 16
TILE_BYTES = 256 * 256 * 4


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.geo_tiles")
    parser.add_argument("--side", type=int, default=6000, help="of the map, in canvas units")
    parser.add_argument("--tiles", type=int, default=60, help="at each level")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory(prefix="geo-tiles-") as folder:
        root, half = Path(folder), given.side / 2
        laid = island((-half, -half, half, half), finest=FINEST, laid=anchor(gsd_m=0.1, turned_deg=30.0))
        for tile, picture in noise(laid):
            write_tile(root, 0, tile, picture, 90)
        before = resident_mb()
        whole: list[float] = []
        for level in range(laid.levels[0] + 3, laid.levels[1] + 3):
            whole += told(level, GeoPyramid((laid,), kept(root)), given.tiles, laid)
        spread = np.percentile(whole, 95)
        print(
            f"all {len(whole)} tiles: median {median(whole):.1f} ms, 95 % {spread:.1f} ms; {resident_mb() - before:.0f} MB more"
        )


def told(level: int, pyramid: GeoPyramid, tiles: int, laid: EarthIsland) -> list[float]:
    """A line about a level; milliseconds of each tile."""
    places = list(islice(spread_over(list(pyramid.tiles(level)), tiles), tiles))
    taken, png = [], []
    for x, y in places:
        start = time.thread_time()
        encoded_tile(pyramid, (level, x, y), MapLook(), None)
        taken.append(1000 * (time.thread_time() - start))
        shown = pyramid.tile(level, x, y)
        if shown is not None:
            start = time.thread_time()
            encoded(shown, MapLook())
            png.append(1000 * (time.thread_time() - start))
    finest = " (finest)" if level == laid.levels[1] else ""
    print(
        f"level {level}{finest}: {len(taken)} tiles, median {median(taken):.1f} ms, 95 % {np.percentile(taken, 95):.1f} ms, "
        f"of which PNG {median(png):.1f} ms",
        flush=True,
    )
    return taken


def spread_over(places: list[tuple[int, int]], tiles: int) -> Iterator[tuple[int, int]]:
    """A run of neighbours out of the middle of the map: a pan."""
    first = max((len(places) - tiles) // 2, 0)
    return iter(places[first:])


def kept(root: Path) -> CanvasTiles:
    """As many of the canvas' tiles as the page keeps."""
    return lru_cache(CANVAS_BYTES // TILE_BYTES)(partial(canvas_tile, root))


def noise(laid: EarthIsland) -> Iterator[tuple[Tile, TilePicture]]:
    """Every tile of the map, each level shrunk from the one below; one in 25 of the finest is missing, one in 11 has a hole."""
    chance = np.random.default_rng(1)
    rough = chance.integers(0, 256, (64, 64, 3), np.uint8)
    below: dict[Tile, np.ndarray] = {}
    for tile in tiles_over(laid.box, FINEST):
        if (tile.x + 7 * tile.y) % 25:
            fine = chance.integers(-9, 10, (256, 256, 3))
            colour = (cv2.resize(np.roll(rough, tile.x, 0), (256, 256)) * 0.8 + 25 + fine).clip(0, 255).astype(np.uint8)
            covered = np.full((256, 256), 255, np.uint8)
            if (tile.x + 3 * tile.y) % 11 == 0:
                covered[100:160, 90:200] = 0
            below[tile] = np.dstack([cv2.copyTo(colour, covered), covered])
    for level in range(FINEST, laid.coarsest - 1, -1):
        for tile, picture in below.items():
            yield tile, TilePicture(picture[..., :3].copy(), picture[..., 3].copy())
        above: dict[Tile, np.ndarray] = {}
        for tile, picture in below.items():
            into = above.setdefault(tile.parent, np.zeros((256, 256, 4), np.uint8))
            left, top = 128 * (tile.x % 2), 128 * (tile.y % 2)
            into[top : top + 128, left : left + 128] = cv2.resize(picture, (128, 128), interpolation=cv2.INTER_AREA)
        below = above if level > laid.coarsest else {}


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


if __name__ == "__main__":
    main()
