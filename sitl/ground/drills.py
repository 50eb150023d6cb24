"""Row crops: every plant varies slightly in position, size and brightness.

Only the plants distinguish one place from another, besides a faint soil texture. The rows are rotated against the raster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array
from .noise import fractal
from .raster import Field, Image, strips

TABLE = 1024  # period in plants and in rows: larger than a small world


@dataclass(frozen=True, slots=True, kw_only=True)
class Drill:
    """spacing: metres between rows; step: metres between plants; width: metres of a plant across its row.

    soil, leaf: BGR; missing: share of plants; stray: standard deviation of a plant's position, as a share of step and width;
    vary: relative standard deviation of its size and brightness; grain: relative soil brightness per standard deviation.
    """

    spacing: float
    step: float
    width: float
    soil: tuple[int, int, int]
    leaf: tuple[int, int, int]
    missing: float = 0.02
    stray: float = 0.08
    vary: float = 0.12
    grain: float = 0.02


MAIZE = Drill(spacing=0.75, step=0.4, width=0.5, soil=(88, 116, 140), leaf=(62, 118, 92))
BERRIES = Drill(spacing=1.5, step=0.7, width=0.8, soil=(96, 128, 150), leaf=(52, 96, 70))
VINES = Drill(spacing=3.0, step=1.3, width=1.1, soil=(92, 132, 138), leaf=(44, 88, 66), missing=0.04)


def paint_drills(drill: Drill, seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR."""
    rng = np.random.default_rng([seed, 10])
    turn = rng.uniform(0.15, 0.5)
    plants = rng.standard_normal((4, TABLE, TABLE), np.float32)
    grows = rng.random((TABLE, TABLE)) >= drill.missing
    grain = fractal(rng, size, coarsest=64)
    picture = np.empty((size, size, 3), np.uint8)
    x = np.arange(size, dtype=np.float32)[None] * np.float32(gsd)
    for rows in strips(size):
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] * np.float32(gsd)
        along = (x * np.cos(turn) + y * np.sin(turn)) / drill.step
        across = (y * np.cos(turn) - x * np.sin(turn)) / drill.spacing
        light, leafy = seen_plants(drill, plants, grows, along, across)
        soil = np.asarray(drill.soil, np.float32) * (1 + drill.grain * grain[rows][..., None])
        leaf = np.asarray(drill.leaf, np.float32) * light[..., None]
        picture[rows] = np.clip(soil + leafy[..., None] * (leaf - soil), 0, 255)
    return picture


def seen_plants(
    drill: Drill, plants: Field, grows: NDArray[np.bool_], along: Array, across: Array
) -> tuple[Array, Array]:
    """Leaf brightness at positions in units of plants and rows, and leaf coverage of the soil, 0 to 1."""
    cell = np.floor(along).astype(int) % TABLE, np.floor(across).astype(int) % TABLE
    ahead, aside, large, light = plants[:, cell[0], cell[1]]
    u = (along % 1 - 0.5 - drill.stray * ahead) * drill.step
    v = (across % 1 - 0.5) * drill.spacing - drill.stray * drill.width * aside
    long, wide = 0.55 * drill.step, 0.5 * drill.width * (1 + drill.vary * large)
    distance = np.sqrt((u / long) ** 2 + (v / wide) ** 2)
    cover = np.clip((1.15 - distance) * 2.5, 0, 1) * grows[cell]
    towards_sun = 1 - 0.25 * v / drill.width
    return (1 + drill.vary * light) * towards_sun * (1.25 - 0.35 * np.minimum(distance, 1)), cover
