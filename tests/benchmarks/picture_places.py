"""Where pictures are judged: squares in which frames overlap, and the places where targets were seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.render.warp_grid import frame_lattice
from sitl.targets import Target
from sitl.truth import Truth
from tests.benchmarks.painted_flights import FrameAlone, PlacedFlight, Seen, Window, place_in_level

Floats = NDArray[np.float64]

SQUARE = 2  # tiles along the side of a square that is judged
AROUND = 2.5  # half diagonals of a target: half the side of the window around it
MARGIN = 12  # px more
APART = 1.3  # half diagonals of both: so far apart one target covers nothing of where another was
CORE = 2.0  # px of the frame around the middle of a mark of 6x6 px where all is the mark, however it is turned


@dataclass(frozen=True, slots=True)
class Sight:
    """A target as one frame saw it: where it is in the window (px), how far it may reach from there (px), how large a frame's
    pixel is there (px).

    alone: no other target was seen so near, then or at another time, that the two could be mixed up.
    """

    frame: str
    target: int
    kind: str
    window: Window
    middle: tuple[float, float]
    reach: float
    frame_pixel: float
    alone: bool


def squares(painted: dict[str, RenderItem], count: int, seed: int = 1) -> list[Window]:
    """At most so many squares, by lot, all of which two frames or more see at the finest level there is."""
    touched = {frame.name: _tiles(frame) for frame in painted.values()}
    finer = {tile.parent for frame in painted.values() for tile in touched[frame.name]}
    finer |= {tile.parent for tile in finer}
    seen = Counter((painted[name].island, tile) for name, tiles in touched.items() for tile in tiles)
    corners = sorted(
        (island, tile)
        for island, tile in seen
        if tile.x % SQUARE == tile.y % SQUARE == 0
        and all(seen[island, one] >= 2 and one not in finer for one in _square(tile))
    )
    chosen = np.random.default_rng(seed).permutation(len(corners))[:count]
    side = SQUARE * TILE_SIZE
    return [
        Window(island, tile.z, tile.x * TILE_SIZE, tile.y * TILE_SIZE, side, side)
        for island, tile in (corners[i] for i in sorted(chosen))
    ]


def sights(truth: Truth, painted: dict[str, RenderItem]) -> list[Sight]:
    """Every target in every painted frame that shows it whole."""
    found = []
    places = [(one.target, one.ground) for frame in truth.frames for one in frame.sightings]
    for frame in truth.frames:
        if frame.name not in painted:
            continue
        for one in frame.sightings:
            target = truth.targets[one.target]
            reach_px = _reach(target) / frame.gsd
            window, middle, pixel = _around(painted[frame.name], one.px, reach_px)
            alone = _is_alone(one.target, one.ground, places, truth.targets)
            found.append(
                Sight(frame.name, one.target, target.kind, window, middle, APART * reach_px * pixel, pixel, alone)
            )
    return found


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames that see something of each window, each alone, in capture order; and the frames of the sights without
    targets, by sight."""

    by_window: dict[Window, list[tuple[str, Seen]]]
    bare: dict[Sight, Seen]


def frames_alone(
    flight: PlacedFlight,
    painted: dict[str, RenderItem],
    settings: PaintSettings,
    windows: Sequence[Window],
    seen: Sequence[Sight],
) -> Frames:
    by_window: dict[Window, list[tuple[str, Seen]]] = {window: [] for window in windows}
    bare: dict[Sight, Seen] = {}
    for frame in sorted(painted.values(), key=lambda one: one.turn):
        tiles = _tiles(frame)
        near = [w for w in by_window if _same_level(w, frame) and not tiles.isdisjoint(w.tiles())]
        if near:
            alone = FrameAlone(flight.load(frame.name), frame, settings)
            for window in near:
                by_window[window].append((frame.name, alone.in_window(window)))
        own = [sight for sight in seen if sight.frame == frame.name]
        if own and flight.bare:
            alone = FrameAlone(flight.bare(frame.name), frame, settings)
            bare |= {sight: alone.in_window(sight.window) for sight in own}
    return Frames(by_window, bare)


def _around(frame: RenderItem, px: Floats, reach_px: float) -> tuple[Window, tuple[float, float], float]:
    """A window around a pixel (2,) of a frame, the pixel in it, and how large a pixel of the frame is there."""
    here, right = place_in_level(frame, np.array([px, px + np.array([1, 0])]))
    pixel = float(np.hypot(*(right - here)))
    half = round(AROUND * reach_px * pixel) + MARGIN
    x, y = (round(float(value)) - half for value in here)
    window = Window(frame.island, frame.level, x, y, 2 * half + 1, 2 * half + 1)
    return window, (float(here[0]) - x, float(here[1]) - y), pixel


def _is_alone(target: int, ground: Floats, places: Sequence[tuple[int, Floats]], targets: Sequence[Target]) -> bool:
    """Still targets are always where they are; a moving one must be away from where it, or another, was at other times."""
    near = 0
    for other, place in places:
        if np.hypot(*(place - ground)) < APART * (_reach(targets[target]) + _reach(targets[other])):
            near += other != target or targets[target].speed > 0
    return near == (targets[target].speed > 0)  # itself


def _reach(target: Target) -> float:
    return float(np.hypot(target.length, target.width)) / 2


def _tiles(frame: RenderItem) -> set[Tile]:
    lattice = frame_lattice(frame.pose, frame.camera, frame.level, frame.relief, frame.dead)
    return set() if lattice is None else set(lattice.tiles())


def _same_level(window: Window, frame: RenderItem) -> bool:
    return (window.island, window.level) == (frame.island, frame.level)


def _square(tile: Tile) -> list[Tile]:
    return [Tile(tile.z, tile.x + i, tile.y + j) for i in range(SQUARE) for j in range(SQUARE)]
