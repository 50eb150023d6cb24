"""Pairs of frames with known overlap, to judge how pairs are judged: `python -m tests.benchmarks.pair_zoo [KIND ...]`.

A kind is a ground, a height to fly at and how tall things stand. Of each, two flights over two worlds of one make give pairs
that overlap much (true), a little (slight) and not at all (false). Says how many of each `register` accepts, how many of
those it lays elsewhere than they were taken, and why it refuses the others.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from sitl.camera import Scene
from sitl.flight import plan
from sitl.geometry import CameraState
from sitl.path import Plan
from sitl.thermal import ThermalCamera
from tests.benchmarks.recorded import RECORDED, SHARED, photographs, read

Array = NDArray[np.float64]

SIZE = (640, 480)
FRAMES = 9  # of either flight
MUCH = 0.3  # overlap from which a pair is called true
ASTRAY = 8.0  # pixels that the median of a pair's inliers may lie off


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """ground: one of sitl's; height: metres flown at; relief: by how much the heights of the ground are multiplied.

    camera: a thermal one that looks on, if any; both flights have the same.
    """

    ground: str
    height: float
    relief: float = 0.0
    camera: ThermalCamera | None = None


KINDS = {
    "rows": Kind(ground="rows", height=60),
    "cars": Kind(ground="cars", height=60),
    "halls": Kind(ground="halls", height=60),
    "maize": Kind(ground="maize", height=40),
    "berries": Kind(ground="berries", height=60),
    "vines": Kind(ground="vines", height=60),
    "orchard": Kind(ground="orchard", height=60, relief=1),
    "orchard-low": Kind(ground="orchard", height=40, relief=1),
    "quarter": Kind(ground="quarter", height=80, relief=1),
    "barracks": Kind(ground="barracks", height=80, relief=1),
    "lake": Kind(ground="lake", height=60),
    "thermal": Kind(ground="country", height=60, relief=1, camera=ThermalCamera()),
    "thermal-weak": Kind(ground="country", height=60, relief=1, camera=ThermalCamera(contrast=0.08)),
    "country": Kind(ground="country", height=60, relief=1),
    "canopy-10": Kind(ground="canopy", height=60, relief=0.6),  # trees of a tenth of the height flown at
    "canopy-20": Kind(ground="canopy", height=60, relief=1.2),
    "canopy-40": Kind(ground="canopy", height=60, relief=2.4),
    "suburb-15": Kind(ground="suburb", height=60, relief=1),
    "suburb-30": Kind(ground="suburb", height=60, relief=2),
}


STRANGERS = "recorded"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """A frame and how it was taken."""

    features: Features
    scene: Scene
    state: CameraState


@dataclass(frozen=True, slots=True)
class LabelledPair:
    """Two frames; overlap: share of either picture whose ground the other shows, 0 in different worlds.

    places_in_b: pixels (n, 2) of a -> the pixels of b that show the same spots, inside b or not; None in different worlds.
    """

    a: Features
    b: Features
    overlap: float
    kind: str
    places_in_b: Callable[[Array], Array] | None = None

    def astray(self, found: Registration) -> bool:
        """Whether the pixels that `found` takes for the same show different spots."""
        if self.places_in_b is None:
            return True
        off = np.linalg.norm(self.places_in_b(found.pixels_a) - found.pixels_b, axis=1)
        return not np.median(off) <= ASTRAY


def pairs(kind: str, seed: int = 1) -> list[LabelledPair]:
    """All pairs of two flights over two worlds of this kind; of "recorded", pairs of frames of different recorded flights.

    KeyError for a kind that is none.
    """
    if kind == STRANGERS:
        return list(pairs_of_strangers(seed))
    flights = [shots(kind, 2 * seed + k) for k in range(2)]
    within = [labelled(a, b, kind) for taken in flights for a, b in combinations(taken, 2)]
    return within + [LabelledPair(a.features, b.features, 0.0, kind) for a, b in product(*flights)]


def pairs_of_strangers(seed: int) -> Iterator[LabelledPair]:
    """Frames of all recorded flights, any of those that the seed leaves, against those of all others."""
    rng = np.random.default_rng([seed, 19])
    for one, other in combinations(RECORDED, 2):
        chosen = [[paths[k] for k in rng.choice(len(paths), 3)] for paths in (photographs(one), photographs(other))]
        yield from (LabelledPair(read(a), read(b), 0.0, STRANGERS) for a, b in product(*chosen))


@lru_cache(maxsize=4)
def shots(kind: str, seed: int) -> tuple[Shot, ...]:
    """The frames of a short survey of three lines."""
    make = KINDS[kind]
    route = Plan(frames=FRAMES, height=make.height, forward=0.6, side=0.45)
    flight = plan("survey", SIZE, seed=seed, ground=make.ground, relief=make.relief, world_size=2048, route=route)
    seen = (flight.scene.picture(state, k) for k, state in enumerate(flight.states))
    if make.camera:
        seen = (make.camera.picture(image, k) for k, image in enumerate(seen))
    taken = zip(seen, flight.states, strict=True)
    return tuple(Shot(features=extract(i, FeatureSettings()), scene=flight.scene, state=s) for i, s in taken)


def labelled(a: Shot, b: Shot, kind: str) -> LabelledPair:
    def places_in_b(pixels: Array) -> Array:
        return seen_by(b, a, pixels)

    return LabelledPair(a.features, b.features, overlap(a, b), kind, places_in_b)


def seen_by(b: Shot, a: Shot, pixels: Array) -> Array:
    """Pixels (n, 2) of a -> pixels of b that show the same spots."""
    return np.asarray(b.scene.pixels_from_ground(b.state, a.scene.ground_from_pixels(a.state, pixels)), np.float64)


def overlap(a: Shot, b: Shot) -> float:
    """Share of the pixels whose spots the other frame shows, of the frame that shares less."""
    grid = np.stack(np.meshgrid(np.arange(8, SIZE[0], 16), np.arange(8, SIZE[1], 16)), -1).reshape(-1, 2).astype(float)
    shares = []
    for one, other in ((a, b), (b, a)):
        there = seen_by(other, one, grid)
        shares.append(float(((there >= 0) & (there <= np.array(SIZE) - 1)).all(axis=1).mean()))
    return min(shares)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a pair. group: true, slight or false; outcome: accepted, astray or why it was refused."""

    group: str
    outcome: str


def judged(pair: LabelledPair, settings: RegistrationSettings) -> Verdict:
    group = "true" if pair.overlap >= MUCH else "slight" if pair.overlap > 0 else "false"
    found = register(pair.a, pair.b, settings)
    if isinstance(found, Registration):
        return Verdict(group, "astray" if pair.astray(found) else "accepted")
    return Verdict(group, re.sub(r"-?\d[\d.]*%?", "N", found.reason))


def rows(kind: str, seed: int, settings: RegistrationSettings) -> Iterator[str]:
    """One line of counts, and one for every reason for which true pairs are refused."""
    verdicts = Counter(judged(pair, settings) for pair in pairs(kind, seed))
    cells = []
    for group in ("true", "slight", "false"):
        outcomes = {v.outcome: n for v, n in verdicts.items() if v.group == group}
        astray, accepted = outcomes.get("astray", 0), outcomes.get("accepted", 0)
        cells.append(f"{accepted:5d} {astray:4d} of {sum(outcomes.values()):3d}")
    yield f"{kind:12} | {' | '.join(cells)}"
    for verdict, count in verdicts.most_common():
        if verdict.group == "true" and verdict.outcome not in ("accepted", "astray"):
            yield f"{'':12} |   true pairs refused: {count} x {verdict.outcome}"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join([*KINDS, STRANGERS])} (all)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    print(f"{'':12} | {' | '.join(f'{group:^17}' for group in ('true', 'slight', 'false'))}")
    print(f"{'kind':12} | {' | '.join(['right wrong of n '] * 3)}")
    for kind in options.kinds or [*KINDS, *([STRANGERS] if SHARED.is_dir() else [])]:
        for row in rows(kind, options.seed, RegistrationSettings()):
            print(row, flush=True)


if __name__ == "__main__":
    main()
