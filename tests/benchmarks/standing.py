"""How many things that stand up are shown whole: houses, walls, masts and trees, counted by truth.

    python -m tests.benchmarks.standing [--seeds 3,4] [--frames 24] [--each] [--without]

A simulated flight is laid by its truth on the plane of the ground, so that all that stands is shifted by its height from frame
to frame. Whose pixels the map shows is read from the cells. A thing is whole if one frame shows nearly all of how it sees it,
and no other shows more than a little of it elsewhere, unless both see it within two pixels of the same place.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render import seam_path
from gcs_mosaic.render.cells import CELL, Owned, Window, window_around
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.render.tile_grid import TILE_SIZE
from sitl.flight import Flight, plan
from sitl.geometry import CameraState, pixels_from_ground
from sitl.ground.standing import KINDS, Standing, things
from sitl.path import Plan
from tests.benchmarks.painted_flights import painted_map, place_in_level, simulated

Array = NDArray[np.float64]
Outline = NDArray[np.float32]

MOST = 0.95  # share of a thing that one frame shows of a whole one: cells of 8 px cut what reaches a little into them
LEAST = 0.05  # share that another frame may show
APART = 2.0  # px between the tops as two frames see them: what is nearer has no step


@dataclass(frozen=True, slots=True)
class Seen:
    """A thing as a frame sees it, in pixels of the map's level: its outline (n, 2), and the middle of its top (2,)."""

    frame: str
    outline: Outline
    top: Outline


@dataclass(frozen=True, slots=True)
class Shown:
    """What the map shows of a thing: by frame, the share of how it sees it; how far the tops of the first two are apart."""

    kind: str
    middle: Outline
    shares: dict[str, float]
    apart: float

    @property
    def state(self) -> str:
        ranked = sorted(self.shares.values(), reverse=True)
        second = ranked[1] if len(ranked) > 1 else 0.0
        if self.apart <= APART or (ranked[0] >= MOST and second <= LEAST):
            return "whole"
        return "doubled" if ranked[0] >= MOST else "cut"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.standing", allow_abbrev=False)
    parser.add_argument("--seeds", default="3,4", help="of the simulated flights (3,4: numbers were chosen on 1 and 2)")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--each", action="store_true", help="tell which things are not whole")
    parser.add_argument("--without", action="store_true", help="as the seam's path alone decides")
    given = parser.parse_args()
    if given.without:
        vars(seam_path)["as_wholes"] = lambda cells, apart, taken: taken
    total = Counter[tuple[str, str]]()
    for seed in map(int, given.seeds.split(",")):
        found = judged(standing_flight(seed, given.frames))
        total.update((one.kind, one.state) for one in found)
        if given.each:
            for one in found:
                if one.state != "whole":
                    print(
                        seed, one.kind, one.state, one.middle.round(), {k: round(v, 2) for k, v in one.shares.items()}
                    )
    for kind in (*KINDS, "all"):
        counts = Counter[str]()
        for (of, state), count in total.items():
            if kind in (of, "all"):
                counts[state] += count
        every = max(sum(counts.values()), 1)
        print(
            f"{kind:6} {every:4}: cut {100 * counts['cut'] / every:5.1f}, doubled {100 * counts['doubled'] / every:5.1f} of 100"
        )


def standing_flight(seed: int, frames: int = 24, size: tuple[int, int] = (1200, 900)) -> Flight:
    return plan("survey", size, seed=seed, ground="standing", relief=1.0, route=Plan(frames=frames, height=80))


def judged(flight: Flight) -> list[Shown]:
    """What the map of a flight shows of each thing that a frame sees whole."""
    with painted_map(simulated(flight), PaintSettings()) as painted:
        window, owner = owners(painted.canvas)
        return list(all_shown(flight, painted.frames, window, owner))


def owners(canvas: TileCompositor) -> tuple[Window, NDArray[np.object_]]:
    """The finest tiles that there are, and whose pixels they show (rows, columns of cells)."""
    territory = canvas._territory
    store, keys = territory._store, list(canvas._recipes)
    finest = max(key[1].z for key in keys)
    window = window_around([key for key in keys if key[1].z == finest])
    owned: Owned = territory._owned([key for key in window.tiles() if (key, "owned") in store], window)
    names = np.array([*territory._names, ""], object)
    return window, names[owned.first]


def all_shown(
    flight: Flight, painted: dict[str, RenderItem], window: Window, owner: NDArray[np.object_]
) -> Iterator[Shown]:
    for thing in things(flight.scene.seed, flight.scene.world.side):
        seen = [
            one
            for name, state in zip(flight.names, flight.states, strict=True)
            if (one := _seen(flight, state, painted[name], thing)) is not None
        ]
        if len(seen) < 2:
            continue
        shares = {one.frame: share for one in seen if (share := _share(one, window, owner)) > 0}
        if not shares:
            continue
        by_name = {one.frame: one for one in seen}
        tops = [by_name[name].top for name in sorted(shares, key=lambda name: -shares[name])[:2]]
        yield Shown(thing.kind, tops[0], shares, float(np.hypot(*(tops[0] - tops[-1]))))


def _seen(flight: Flight, state: CameraState, painted: RenderItem, thing: Standing) -> Seen | None:
    """None where the frame does not see all of it."""
    lens, half = flight.scene.camera.lens, flight.scene.world.side / 2
    rings = [(thing.foot, 0.0), (thing.foot, thing.shoulder), (thing.top, thing.height)]
    pixels = np.concatenate([pixels_from_ground(lens, state, ring - half, height) for ring, height in rings])
    if not ((pixels > 2).all() and (pixels < np.array([lens.width - 3, lens.height - 3])).all()):
        return None
    places = place_in_level(painted, pixels)
    hull = np.asarray(cv2.convexHull(places.astype(np.float32))[:, 0], np.float32)
    return Seen(painted.name, hull, places[-len(thing.top) :].mean(axis=0).astype(np.float32))


def _share(seen: Seen, window: Window, owner: NDArray[np.object_]) -> float:
    """How much of a thing as a frame sees it the map shows from that frame, by area."""
    corner = np.array([window.left, window.top]) * TILE_SIZE
    outline = seen.outline - corner
    (left, top), (right, bottom) = np.floor(outline.min(axis=0)).astype(int), np.ceil(outline.max(axis=0)).astype(int)
    if min(left, top) < 0 or right >= owner.shape[1] * CELL or bottom >= owner.shape[0] * CELL:
        return 0.0
    mask = np.zeros((bottom - top + 1, right - left + 1), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outline - [left, top]).astype(np.int32), 1)
    rows, columns = np.nonzero(mask)
    return float((owner[(rows + top) // CELL, (columns + left) // CELL] == seen.frame).mean())


if __name__ == "__main__":
    main()
