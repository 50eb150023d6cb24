"""The ground of a flight: an image pyramid from above, and a height map.

The centre of the world is (0, 0): metres, x east, y south. Outside, the ground is mirrored, so that oblique views see
something; there is no ground truth there.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import Array
from .ground.copies import paint_copies
from .ground.drills import BERRIES, MAIZE, VINES, paint_drills
from .ground.heights import CELL, height_map, single_hill
from .ground.lake import paint_lake
from .ground.land import lay_out
from .ground.orchard import raise_canopy, raise_orchard
from .ground.paint import paint
from .ground.pattern import car_park, crop_rows, paint_pattern
from .ground.quarter import BARRACKS, QUARTER, raise_blocks
from .ground.raster import Field, Image
from .ground.shapes import Land
from .ground.snow import paint_snow
from .ground.standing import raise_standing
from .ground.suburb import raise_suburb
from .ground.water import paint_water
from .ground.woods import paint_floor, raise_woods
from .wind import Wind

PAINT_VERSION = 1  # increment when a seed's picture changes: invalidates cached worlds
COARSEST = 32  # pixels; side of the coarsest pyramid level


@dataclass(frozen=True, slots=True)
class World:
    """levels: pictures (size, size, 3) BGR, each half the previous size; heights: metres; gsd: metres per pixel of levels[0].

    sheer: objects are so tall that rays must be traced to their first intersection. water: share of each pixel of levels[0]
    that is water with moving waves, 0 to 1. wind: what moves in it.
    """

    levels: tuple[Image, ...]
    heights: Field
    gsd: float
    sheer: bool = False
    water: Field | None = None
    wind: Wind | None = None

    @property
    def side(self) -> float:
        return len(self.levels[0]) * self.gsd

    def contains(self, ground: Array) -> NDArray[np.bool_]:
        """Mask of the points (..., 2) inside the world; NaN is outside."""
        with np.errstate(invalid="ignore"):
            return np.asarray((np.abs(ground) < self.side / 2).all(-1))

    def height_at(self, x: Array, y: Array, relief: float = 1.0) -> Array:
        """Metres, interpolated bilinearly between cell centres."""
        flat = np.atleast_2d(x)
        column, row = (self.cell_of(np.atleast_2d(place), len(self.heights)) for place in (x, y))
        found = cv2.remap(self.heights, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(found.reshape(flat.shape) * np.float32(relief), x.dtype).reshape(x.shape)

    def cell_of(self, place: Array, cells: int) -> Field:
        """Position along one side in a raster of so many cells."""
        return np.nan_to_num(mirrored(place / (self.side / cells), cells)).astype(np.float32)

    def water_at(self, x: Array, y: Array) -> Field:
        """Share of water at points (h, w), 0 to 1; 0 where not finite."""
        if self.water is None:
            return np.zeros(x.shape, np.float32)
        column, row = (
            mirrored(np.nan_to_num(place) / self.gsd, len(self.water)).astype(np.float32) for place in (x, y)
        )
        seen = cv2.remap(self.water, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.where(np.isfinite(x), seen, 0).astype(np.float32)

    def colours(self, x: Array, y: Array, octave: Array) -> Field:
        """(h, w, 3) BGR at points (h, w), interpolated between the two levels nearest to the octave, log2(pixel size / gsd);
        NaN is black."""
        out = np.zeros((*x.shape, 3), np.float32)
        octave = np.clip(np.nan_to_num(octave), 0, len(self.levels) - 1)
        for level in range(int(octave.min()), int(np.ceil(octave.max())) + 1):
            share = 1 - np.abs(octave - level)
            used: NDArray[np.bool_] = np.logical_and(share > 0, np.isfinite(x))
            if used.any():
                box = span(used.any(axis=1)), span(used.any(axis=0))
                weight = np.where(used[box], share[box], 0)[..., None]
                out[box] += weight * self.sample(level, x[box], y[box], used[box])
        return out

    def sample(self, level: int, x: Array, y: Array, used: NDArray[np.bool_]) -> Field:
        """(h, w, 3) colours of one level; reads only the part of the level in use (it may be memory-mapped)."""
        picture, scale = self.levels[level], self.gsd * 2**level
        column, row = (mirrored(np.nan_to_num(place) / scale, len(picture)).astype(np.float32) for place in (x, y))
        window = tuple(span_of(place[used], len(picture)) for place in (row, column))
        crop = np.ascontiguousarray(picture[window[0], window[1]])
        column, row = column - np.float32(window[1].start), row - np.float32(window[0].start)
        seen = cv2.remap(crop, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, np.float32)


def mirrored(place: Array, size: int) -> Array:
    """Position in pixels from the world's centre -> pixel index in a raster of `size`, mirrored at the borders."""
    period = 2 * size
    folded = np.abs((place - size / 2) % period - size)
    return np.asarray(folded - 0.5)


def span(used: Any) -> slice:
    """Slice from the first to the last true element."""
    where = np.flatnonzero(used)
    return slice(int(where[0]), int(where[-1]) + 1)


def span_of(index: Array, size: int) -> slice:
    """Slice of a raster that covers all indices plus the neighbours needed for interpolation."""
    low, high = int(np.floor(index.min())) - 2, int(np.ceil(index.max())) + 3
    return slice(min(max(0, low), size - 1), max(1, min(size, high)))


COUNTRY = "country"
BARE: dict[str, Callable[[int, int, float], Image]] = {
    "rows": lambda seed, size, gsd: paint_pattern(crop_rows(), seed, size, gsd),
    "cars": lambda seed, size, gsd: paint_pattern(car_park(), seed, size, gsd),
    "water": paint_water,
    "halls": paint_copies,
    "maize": lambda seed, size, gsd: paint_drills(MAIZE, seed, size, gsd),
    "berries": lambda seed, size, gsd: paint_drills(BERRIES, seed, size, gsd),
    "vines": lambda seed, size, gsd: paint_drills(VINES, seed, size, gsd),
    "snow": paint_snow,
    "floor": paint_floor,
}  # grounds with a picture only, (seed, side in pixels, metres per pixel) -> picture; their heights are hills
RAISED: dict[str, Callable[[int, int, float], tuple[Image, Field]]] = {
    "orchard": raise_orchard,
    "canopy": raise_canopy,
    "quarter": lambda seed, size, gsd: raise_blocks(QUARTER, seed, size, gsd),
    "barracks": lambda seed, size, gsd: raise_blocks(BARRACKS, seed, size, gsd),
    "suburb": raise_suburb,
    "standing": raise_standing,
    "hill": lambda seed, size, gsd: (paint(lay_out(seed, size * gsd), seed, size, gsd), single_hill(size, gsd)),
}  # grounds with a picture and the heights of the objects, on a plane
LAKE = "lake"  # a plane with water and moving waves
WOODS = "woods"  # crowns on a plane that sway in the wind
GROUNDS = (COUNTRY, LAKE, WOODS, *BARE, *RAISED)


@lru_cache(maxsize=2)
def make_world(
    seed: int = 1, size: int = 6144, gsd: float = 0.1, cache: Path | None = None, ground: str = COUNTRY
) -> World:
    """The world of this seed, (size, size) pixels of `gsd` metres; with a cache folder it is painted only once.

    ground: one of GROUNDS; "country", "canopy", "suburb", "woods" and "snow" are realistic; all others are adversarial:
    repetitive or self-similar.
    """
    if cache is None:
        return painted(seed, size, gsd, ground)
    folder = cache / f"world-{PAINT_VERSION}-{ground}-{seed}-{size}-{gsd:g}"
    if not folder.is_dir():
        save(painted(seed, size, gsd, ground), folder)
    return load(folder, gsd, seed, sheer=ground in RAISED or ground == WOODS)


def painted(seed: int, size: int, gsd: float, ground: str) -> World:
    """`make_world` without a cache."""
    if ground in RAISED:
        picture, heights = RAISED[ground](seed, size, gsd)
        return World(pyramid(picture), heights, gsd, sheer=True)
    if ground == WOODS:
        wood = raise_woods(seed, size, gsd)
        return World(pyramid(wood.picture), wood.heights, gsd, sheer=True, wind=Wind(wood.owner, seed))
    if ground == LAKE:
        picture, water = paint_lake(seed, size, gsd)
        return World(pyramid(picture), np.zeros((size // CELL,) * 2, np.float32), gsd, water=water)
    land = lay_out(seed, size * gsd) if ground == COUNTRY else Land(size * gsd)
    picture = paint(land, seed, size, gsd) if ground == COUNTRY else BARE[ground](seed, size, gsd)
    return World(pyramid(picture), height_map(seed, land, size, gsd), gsd)


def pyramid(picture: Image) -> tuple[Image, ...]:
    levels = [picture]
    while len(levels[-1]) > COARSEST:
        half = len(levels[-1]) // 2
        levels.append(np.asarray(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA), np.uint8))
    return tuple(levels)


def save(world: World, folder: Path) -> None:
    """Write to a temporary folder and rename: two flights may paint the same world at once."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(dir=folder.parent))
    for k, level in enumerate(world.levels):
        np.save(beside / f"level-{k:02d}.npy", level)
    np.save(beside / "heights.npy", world.heights)
    if world.water is not None:
        np.save(beside / "water.npy", world.water)
    if world.wind is not None:
        np.save(beside / "owner.npy", world.wind.owner)
    try:
        beside.rename(folder)
    except OSError:
        shutil.rmtree(beside)


def load(folder: Path, gsd: float, seed: int, *, sheer: bool) -> World:
    levels: list[Any] = [np.load(path, mmap_mode="r") for path in sorted(folder.glob("level-*.npy"))]
    water = np.load(folder / "water.npy") if (folder / "water.npy").exists() else None
    wind = Wind(np.load(folder / "owner.npy"), seed) if (folder / "owner.npy").exists() else None
    return World(tuple(levels), np.load(folder / "heights.npy"), gsd, sheer, water, wind)
