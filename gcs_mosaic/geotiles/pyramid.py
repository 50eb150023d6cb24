"""The map of a flight on earth as one pyramid of XYZ tiles, and as pictures of any size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gcs_mosaic.geo.ellipsoid import wrapped
from gcs_mosaic.geo.mercator import HALF_WORLD_M, TILE_SIZE, resolution_m
from gcs_mosaic.geotiles.canvas_tiles import CanvasTiles, divided
from gcs_mosaic.geotiles.earth_islands import Bounds, EarthIsland
from gcs_mosaic.geotiles.picture_grid import PictureGrid, grid_of_tile
from gcs_mosaic.geotiles.warp import PixelWindow, warped, windows
from gcs_mosaic.stitch.arrays import ImageBGRA

OVERZOOM = 6  # levels beyond the finest: stations that ask go on to 22 or so, whatever the map's resolution
BLOCK = TILE_SIZE  # px of a picture that are made at a time


@dataclass(frozen=True, slots=True)
class GeoPyramid:
    """Islands on earth, the last on top, and where their canvas' tiles come from; a tile is a function of these alone."""

    islands: Sequence[EarthIsland]
    canvas: CanvasTiles

    def only(self, island: int) -> Self:
        """With this island alone, or none."""
        return replace(self, islands=tuple(one for one in self.islands if one.id == island))

    @property
    def levels(self) -> tuple[int, int] | None:
        """From the coarsest level that is worth showing to that of the finest pixels; None without an island."""
        every = [one.levels for one in self.islands]
        return (min(coarsest for coarsest, _ in every), max(finest for _, finest in every)) if every else None

    @property
    def bounds(self) -> Bounds | None:
        """Degrees; all round the earth if an island lies across the 180th meridian. None without an island."""
        found = _around([one.bounds for one in self.islands])
        return found if found is None or found[2] <= 180 else (-180.0, found[1], 180.0, found[3])

    @property
    def reach(self) -> Bounds | None:
        """Degrees, as `bounds`; but beyond the 180th meridian longitudes go on, so that west and east are never far apart."""
        if not self.islands:
            return None
        first = self.islands[0].bounds[0]
        turns = [360.0 * round((first - one.bounds[0]) / 360) for one in self.islands]
        moved = [(one.bounds[0] + by, one.bounds[2] + by) for one, by in zip(self.islands, turns, strict=True)]
        souths, norths = [one.bounds[1] for one in self.islands], [one.bounds[3] for one in self.islands]
        return min(west for west, _ in moved), min(souths), max(east for _, east in moved), max(norths)

    @property
    def middle(self) -> tuple[float, float] | None:
        """Longitude and latitude in degrees."""
        return None if self.reach is None else middle_of(self.reach)

    @property
    def mercator_bounds(self) -> Bounds | None:
        """As `bounds`, in metres of Web Mercator."""
        found = _around([one.mercator_bounds for one in self.islands])
        if found is None or found[2] <= HALF_WORLD_M:
            return found
        return -HALF_WORLD_M, found[1], HALF_WORLD_M, found[3]

    def tile(self, level: int, x: int, y: int) -> ImageBGRA | None:
        """An XYZ tile (256, 256, 4); None where nothing was seen, and at levels that are too coarse or too fine."""
        if self.levels is None or not self.levels[0] <= level <= self.levels[1] + OVERZOOM:
            return None
        return self.picture(grid_of_tile(level, x, y)) if max(x, y) < 1 << level and min(x, y) >= 0 else None

    def tiles(self, level: int) -> Iterator[tuple[int, int]]:
        """x and y of the tiles of a level that may show something, row by row; each once."""
        found = {place for one in self.islands for place in _tiles_over(one.mercator_bounds, level)}
        yield from sorted(found, key=lambda place: place[::-1])

    def corner_tiles(self, level: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """x and y of the first and the last tile of a level between which all lies. ValueError without an island."""
        if self.mercator_bounds is None:
            raise ValueError("a map without an island has no corners")
        west, south, east, north = self.mercator_bounds
        side, last = resolution_m(level) * TILE_SIZE, (1 << level) - 1
        first = int((west + HALF_WORLD_M) // side), int((HALF_WORLD_M - north) // side)
        final = int((east + HALF_WORLD_M) // side), int((HALF_WORLD_M - south) // side)
        return (max(first[0], 0), max(first[1], 0)), (min(final[0], last), min(final[1], last))

    def picture(self, grid: PictureGrid) -> ImageBGRA | None:
        """A picture (h, w, 4) with the islands in it; None if there is none."""
        found = [(one, window) for one in self.islands for window in windows(grid, one)]
        picture: ImageBGRA | None = None
        for island, window in found:
            for block in blocks(window):
                part = warped(grid, block, island, self.canvas)
                if part is not None:
                    picture = np.zeros((grid.height, grid.width, 4), np.uint8) if picture is None else picture
                    _lay_over(picture[block.top : block.bottom, block.left : block.right], part)
        return None if picture is None or not picture.any() else divided(picture)


def middle_of(bounds: Bounds) -> tuple[float, float]:
    """Longitude and latitude in degrees of the middle of bounds that may go on beyond 180 degrees."""
    west, south, east, north = bounds
    return float(wrapped((west + east) / 2)), (south + north) / 2


def blocks(window: PixelWindow) -> Iterator[PixelWindow]:
    """A window in parts of `BLOCK` px at most, as the whole picture is divided."""
    for top in range(window.top // BLOCK * BLOCK, window.bottom, BLOCK):
        for left in range(window.left // BLOCK * BLOCK, window.right, BLOCK):
            yield PixelWindow(
                max(left, window.left),
                max(top, window.top),
                min(left + BLOCK, window.right),
                min(top + BLOCK, window.bottom),
            )


def _lay_over(below: ImageBGRA, above: ImageBGRA) -> None:
    """Put a picture over another in its place; the colours of both are multiplied by coverage."""
    share = 255 - above[..., 3:].astype(np.uint16)
    below[...] = above + ((below * share + 127) // 255).astype(np.uint8)


def _around(every: Sequence[Bounds]) -> Bounds | None:
    if not every:
        return None
    west, south, east, north = zip(*every, strict=True)
    return min(west), min(south), max(east), max(north)


def _tiles_over(bounds: Bounds, level: int) -> Iterator[tuple[int, int]]:
    """The tiles of a level that bounds (metres) touch; beyond the 180th meridian they begin anew in the west."""
    west, south, east, north = bounds
    side, count = resolution_m(level) * TILE_SIZE, 1 << level
    for y in range(int((HALF_WORLD_M - north) // side), int((HALF_WORLD_M - south) // side) + 1):
        for x in range(int((west + HALF_WORLD_M) // side), int((east + HALF_WORLD_M) // side) + 1):
            if 0 <= y < count:
                yield x % count, y
