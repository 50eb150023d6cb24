"""What layers and gaps cost as a flight grows: python -m tests.benchmarks.layers [FRAMES ...]

A table of frames on lanes, as the ledger would give it; no pictures. Times on one core: the whole island's grid with its gaps,
which is made at most every few seconds, and single tiles from the finest to the coarsest level.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from pathlib import Path

import numpy as np

from gcs_mosaic.render.tile_grid import Tile, tile_range
from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.flight_view import FlightView, FrameTable, table_of
from gcs_mosaic.views.layers import LAYERS, LayerTiles

CAMERA = Camera(4000, 3000, focal=1.3, k1=-0.05)
STEP = 1000.0  # canvas units between frames: three quarters of overlap
TILES = 20  # asked for at each level


class OfTable(FlightView):
    """A flight that is nothing but a table."""

    def __init__(self, table: FrameTable) -> None:
        super().__init__(Path())
        self._fixed = table

    def table(self, at_least: int = 0) -> FrameTable:
        return self._fixed

    def taken(self, table: FrameTable) -> Array:
        return np.zeros(len(table.frames))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.layers")
    parser.add_argument("frames", type=int, nargs="*", default=[1000, 10_000, 100_000])
    for frames in parser.parse_args().frames:
        print(cost(frames), flush=True)


def cost(frames: int) -> str:
    """One line about a flight of so many frames."""
    tiles = LayerTiles(OfTable(table_of(1, list(positions(frames)))))
    start = time.perf_counter()
    seen = tiles.islands.of(0)
    coverage, gaps = seen.coverage, seen.gaps
    whole_s = time.perf_counter() - start
    assert coverage is not None
    taken = {level: each_ms(tiles, level, coverage.grid.box) for level in (16, 14, 12, 10, 8)}
    each = ", ".join(f"level {level} {ms:.1f}" for level, ms in taken.items())
    return f"{frames} frames: island's grid and {len(gaps)} gaps {whole_s:.2f} s; a tile in ms (median): {each}"


def each_ms(tiles: LayerTiles, level: int, box: tuple[float, float, float, float]) -> float:
    """Median time of a tile at a level, anywhere on the island."""
    chance = np.random.default_rng(level)
    first, last = tile_range(box, level)
    taken = []
    for _ in range(TILES):
        x, y = chance.integers([first.x, first.y], [last.x + 1, last.y + 1]).tolist()
        start = time.perf_counter()
        tiles.tile(LAYERS["looks"], 0, Tile(level, x, y))
        taken.append(1000 * (time.perf_counter() - start))
    return statistics.median(taken)


def positions(frames: int) -> list[PositionRecord]:
    """Lanes that make a square, here and there a frame left out."""
    columns = math.isqrt(frames)
    places = [(k % columns, k // columns) for k in range(frames) if k % 997]
    return [
        PositionRecord(
            number=k + 1,
            name=f"{k}.jpg",
            island=0,
            order=k,
            level=16,
            pose=Pose(column * STEP, row * STEP, yaw=0.05 * (row % 2)),
            camera=CAMERA,
            modified=1.7e9 + k,
        )
        for k, (column, row) in enumerate(places)
    ]


if __name__ == "__main__":
    main()
