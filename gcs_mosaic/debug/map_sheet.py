"""Pictures of a whole island: footprints and links, and match residuals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from gcs_mosaic.debug.sheet import FAINT, INK, PAPER, Colour, Sheet, nice_length, rainbow
from gcs_mosaic.stitch.arrays import ImageBGR, PointsNx2
from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.graph.observer import Residuals
from gcs_mosaic.stitch.graph.placement import Placement

LONGER_SIDE = 1600  # px of the map on the sheet
MARGIN, HEAD = 40, 64  # px around the map, and above it for text
MOST_NAMES = 150  # frames beyond which only some are numbered
MOST_ARROWS = 4000
LONGEST_ARROW = 60.0  # px for a large residual (95 %), if there are few arrows


class MapSheet:
    """A sheet with an island, north (the first frame's top) up."""

    def __init__(self, placements: Sequence[Placement], title: str) -> None:
        self.placements = placements
        self.outlines = [geometry.footprint(p.pose, p.camera) for p in placements]
        everything = np.concatenate(self.outlines)
        low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
        self._scale = LONGER_SIDE / float(max(high - low))
        self._low = low
        width, height = np.ceil((high - low) * self._scale).astype(int) + 2 * MARGIN
        self.sheet = Sheet(int(width), int(height) + HEAD)
        self.sheet.words((MARGIN, 36), title, size=20)

    @property
    def canvas_from_sheet(self) -> float:
        """Canvas units per pixel of the sheet."""
        return 1 / self._scale

    def at(self, places: PointsNx2) -> PointsNx2:
        """Sheet positions (n, 2) of canvas places (n, 2)."""
        return np.asarray((places - self._low) * self._scale + [MARGIN, MARGIN + HEAD])

    def middles(self) -> PointsNx2:
        """Sheet positions (n, 2) of the frames' centres; NaN above the horizon."""
        return np.concatenate(
            [self.at(geometry.canvas_from_pixels(p.pose, p.camera, p.camera.centre[None])) for p in self.placements]
        )

    def say(self, words: str) -> None:
        """A second line under the title."""
        self.sheet.words((MARGIN, 62), words, size=14)


def draw_footprints(placements: Sequence[Placement]) -> ImageBGR:
    """All footprints of an island, coloured by flight order, numbered, with the links between their centres."""
    island = MapSheet(placements, f"{len(placements)} footprints, from the first (blue) to the last (red)")
    links = _links(placements)
    island.say(f"{len(links)} links; numbers count the frames from 1")
    colours = rainbow(np.linspace(0, 1, len(placements)))
    for outline, colour in zip(island.outlines, colours, strict=True):
        if np.isfinite(outline).all():
            island.sheet.fill(island.at(outline), colour, 0.06)
    middles = island.middles()
    for a, b in links:
        island.sheet.lines(middles[[a, b]], (170, 165, 160), 0.8)
    for outline, colour in zip(island.outlines, colours, strict=True):
        island.sheet.lines(island.at(outline), colour, 1.2, closed=True)
    _number(island, middles, colours)
    return island.sheet.picture()


def draw_residuals(placements: Sequence[Placement], residuals: Sequence[Residuals]) -> ImageBGR:
    """Match residuals of an island: magnified arrows from a point's place in one frame to that in another."""
    places = np.concatenate([frame.places for frame in residuals])
    misses = np.concatenate([frame.misses for frame in residuals])
    seen = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(misses).all(axis=1))
    lengths = np.linalg.norm(misses[seen], axis=1)
    island = MapSheet(placements, f"What {len(seen) // 2} matches miss by, lens and relief applied")
    median, p95 = np.quantile(lengths, [0.5, 0.95])
    island.say(f"median {median:.2f}, 95 % {p95:.2f} canvas units; one unit is a pixel of the first frame")
    for outline in island.outlines:
        island.sheet.lines(island.at(outline), FAINT, 0.8, closed=True)
    shown = seen[np.linspace(0, len(seen) - 1, min(len(seen), MOST_ARROWS)).astype(int)]
    magnified = _magnification(island, len(shown), p95)
    starts = island.at(places[shown])
    ends = island.at(places[shown] + magnified * misses[shown])
    colours = rainbow(np.linalg.norm(misses[shown], axis=1) / (2 * p95))
    for start, end, colour in zip(starts, ends, colours, strict=True):
        island.sheet.arrow(start, end, colour, 0.9)
    _scale_bar(island, magnified)
    return island.sheet.picture()


def _links(placements: Sequence[Placement]) -> list[tuple[int, int]]:
    row = {placement.name: number for number, placement in enumerate(placements)}
    pairs = {(row[p.name], row[other]) for p in placements for other in p.neighbours if other in row}
    return sorted((a, b) for a, b in pairs if a < b)


def _number(island: MapSheet, middles: PointsNx2, colours: Sequence[Colour]) -> None:
    every = -(-len(middles) // MOST_NAMES)
    for number, (middle, colour, placement) in enumerate(
        zip(middles, colours, island.placements, strict=True), start=1
    ):
        if np.isfinite(middle).all():
            island.sheet.dot(middle, 3, colour)
            if every == 1 or number % every == 1:
                said = f"{number} {PurePosixPath(placement.name).stem}" if len(middles) <= 20 else str(number)
                island.sheet.words((middle[0], middle[1] - 7), said, INK, 13, "middle", halo=PAPER)


def _magnification(island: MapSheet, count: int, p95: float) -> float:
    """Arrow scale: a large residual (95 %) is drawn about twice as long as the arrow spacing, as most are far smaller."""
    apart = np.sqrt(island.sheet.width * island.sheet.height / max(count, 1))
    length = min(2 * apart, LONGEST_ARROW) * island.canvas_from_sheet
    return nice_length(float(max(length / max(p95, 1e-6), 1.0)))


def _scale_bar(island: MapSheet, magnified: float) -> None:
    """Arrow of a residual of a round length."""
    length = nice_length(160 * island.canvas_from_sheet / magnified)
    width = length * magnified / island.canvas_from_sheet
    right, y = island.sheet.width - MARGIN, 34.0
    island.sheet.arrow(np.array([right - width, y]), np.array([right, y]), INK, 1.5)
    island.sheet.words((right, y + 28), f"{length:g} units, magnified {magnified:g} times", size=14, anchor="right")
