"""Vector layout of the ground: parcels with crops, roads and tracks, buildings, trees.

All in metres from the north-west corner of the world, x east, y south.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Colour = tuple[int, int, int]  # BGR


@dataclass(frozen=True, slots=True)
class Crop:
    """Appearance of a field: its colour, the colour of its patches, rows (spacing in metres, strength), relative frequency."""

    name: str
    colour: Colour
    patch: Colour
    row_spacing: float = 50.0
    row_strength: float = 0.0
    weight: float = 0.0


CROPS = (
    Crop("wheat", (98, 154, 178), (88, 136, 162), 0.5, 0.05, 3),
    Crop("stubble", (120, 160, 180), (102, 136, 156), 1.4, 0.09, 3),
    Crop("ploughed", (64, 84, 106), (82, 104, 126), 0.9, 0.17, 3),
    Crop("beet", (58, 106, 80), (72, 106, 108), 0.8, 0.16, 2),
    Crop("clover", (66, 118, 92), (74, 132, 122), 3.0, 0.03, 2),
    Crop("meadow", (76, 114, 104), (92, 128, 134), 6.0, 0.05, 3),
    Crop("rape", (62, 160, 168), (66, 142, 138), 0.6, 0.07, 0.7),
    Crop("fallow", (96, 126, 132), (78, 108, 106), 2.2, 0.04, 2),
    Crop("wood", (44, 70, 54), (52, 84, 70), 9.0, 0.02, 1.2),
)
DIRT = Crop("dirt", (112, 142, 160), (96, 122, 140))
GRASS = Crop("grass", (72, 104, 92), (84, 122, 122))
STREAM = Crop("stream", (78, 80, 66), (64, 74, 62))
YARD = Crop("yard", (138, 148, 152), (118, 128, 136))


@dataclass(frozen=True, slots=True)
class Parcel:
    corners: Points  # (4, 2)
    crop: Crop
    row_heading: float  # radians; direction of the rows


@dataclass(frozen=True, slots=True)
class Way:
    points: Points  # (n, 2)
    width: float
    kind: Literal["asphalt", "dirt", "grass", "stream"]


@dataclass(frozen=True, slots=True)
class Building:
    centre: Points  # (2,)
    length: float
    width: float
    heading: float
    height: float
    roof: Colour

    def outline(self) -> tuple[Points, Points]:
        """Corners (4, 2), and ends of the ridge (2, 2)."""
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        along, aside = np.array([cos, sin]) * self.length / 2, np.array([-sin, cos]) * self.width / 2
        corners = self.centre + np.array([-along - aside, along - aside, along + aside, -along + aside])
        return corners, self.centre + np.array([-along, along])


@dataclass(frozen=True, slots=True)
class Tree:
    x: float
    y: float
    radius: float
    height: float
    tone: Colour


@dataclass(slots=True)
class Land:
    """All shapes in a square of `side` metres."""

    side: float
    parcels: list[Parcel] = field(default_factory=list)
    ways: list[Way] = field(default_factory=list)
    buildings: list[Building] = field(default_factory=list)
    trees: list[Tree] = field(default_factory=list)


def area(corners: Points) -> float:
    """Area of a polygon (n, 2) in square metres."""
    following = np.roll(corners, -1, axis=0)
    return float(abs(np.sum(corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1])) / 2)
