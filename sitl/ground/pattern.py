"""Repetitive ground: one cell on a lattice, as in a planted field or a car park.

A cell is empty or full, and full ones have one of a few tones; only this distinguishes one place from another, besides a
faint grain. The lattice is rotated against the raster.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..geometry import Array
from .noise import fractal
from .raster import Field, Image, strips

CELL_PX = 96  # pixels along the longer side of a cell's picture
TABLE = 512  # period of occupancy and tones in cells, both ways: larger than a world


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """pitch: metres of a cell (along, across); empty, full: pictures (h, w, 3) of a cell in BGR, 0 to 255; occupied:
    share of full cells; tones: BGR factors of the object in a full cell; grain: relative brightness per standard
    deviation."""

    pitch: tuple[float, float]
    empty: Field
    full: Field
    occupied: float
    tones: tuple[tuple[float, float, float], ...]
    grain: float


def paint_pattern(pattern: Pattern, seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR."""
    rng = np.random.default_rng([seed, 6])
    turn = rng.uniform(0.15, 0.5)
    occupied = rng.random((TABLE, TABLE)) < pattern.occupied
    tones = np.asarray(pattern.tones, np.float32)[rng.integers(len(pattern.tones), size=(TABLE, TABLE))]
    grain = fractal(rng, size, coarsest=64)
    thing = (pattern.full != pattern.empty).any(axis=2, keepdims=True).astype(np.float32).repeat(3, axis=2)
    picture = np.empty((size, size, 3), np.uint8)
    x = np.arange(size, dtype=np.float32)[None] * np.float32(gsd)
    for rows in strips(size):
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] * np.float32(gsd)
        along = (x * np.cos(turn) + y * np.sin(turn)) / pattern.pitch[0]
        across = (y * np.cos(turn) - x * np.sin(turn)) / pattern.pitch[1]
        cell = np.floor(along).astype(int) % TABLE, np.floor(across).astype(int) % TABLE
        empty, full, there = (seen_in_cell(kind, along, across) for kind in (pattern.empty, pattern.full, thing))
        colour = empty + there * occupied[cell][..., None] * (full * tones[cell] - empty)
        picture[rows] = np.clip(colour * (1 + pattern.grain * grain[rows][..., None]), 0, 255)
    return picture


def seen_in_cell(cell: Field, along: Array, across: Array) -> Field:
    """Colours (h, w, 3) of a cell's picture at positions in units of cells."""
    height, width = cell.shape[:2]
    column, row = ((place % 1 * side - 0.5).astype(np.float32) for place, side in ((along, width), (across, height)))
    return np.asarray(cv2.remap(cell, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)


def crop_rows() -> Pattern:
    """Identical bushes 1.2 m apart in rows 2.5 m apart; one in thirty is missing."""
    pitch = 1.2, 2.5
    empty = blank(pitch, (84, 112, 132))
    full = empty.copy()
    height, width = full.shape[:2]
    middle = width // 2, height // 2
    cv2.ellipse(full, (middle[0] + 3, middle[1] - 6), (width * 2 // 5, width // 3), 0, 0, 360, (40, 58, 66), -1)
    cv2.ellipse(full, middle, (width * 2 // 5, width * 2 // 5), 0, 0, 360, (58, 104, 84), -1)
    cv2.ellipse(full, (middle[0] - 4, middle[1] + 4), (width // 5, width // 6), 0, 0, 360, (84, 140, 116), -1)
    tones = tuple((light, light, light) for light in (0.96, 1.0, 1.04))
    return Pattern(pitch=pitch, empty=empty, full=full, occupied=0.97, tones=tones, grain=0.015)


def car_park() -> Pattern:
    """Bays of 2.5 m beside an aisle, painted lines, and identical cars in four colours in 6 of 10 bays."""
    pitch = 2.5, 8.0
    empty = blank(pitch, (104, 102, 100))
    height, width = empty.shape[:2]
    bay = round(height * 5 / 8)
    cv2.line(empty, (0, 0), (0, bay), (215, 220, 220), 2)
    cv2.line(empty, (width - 1, 0), (width - 1, bay), (215, 220, 220), 2)
    full = empty.copy()
    left, right, top, bottom = width // 6, width - width // 6, bay // 12, bay - bay // 12
    cv2.rectangle(full, (left - 2, top + 2), (right - 2, bottom + 2), (42, 40, 40), -1)
    cv2.rectangle(full, (left, top), (right, bottom), (190, 190, 190), -1)
    length = bottom - top
    for share, thick in ((0.3, 0.14), (0.85, 0.08)):
        start = top + round(share * length)
        cv2.rectangle(full, (left + 2, start), (right - 2, start + round(thick * length)), (46, 40, 38), -1)
    tones = ((1.0, 1.0, 1.0), (0.4, 0.4, 0.42), (0.45, 0.5, 0.9), (0.85, 0.55, 0.4))
    return Pattern(pitch=pitch, empty=empty, full=full, occupied=0.6, tones=tones, grain=0.02)


def blank(pitch: tuple[float, float], colour: tuple[int, int, int]) -> Field:
    """A cell's picture in a single colour."""
    scale = CELL_PX / max(pitch)
    return np.full((round(pitch[1] * scale), round(pitch[0] * scale), 3), colour, np.float32)
