"""What is found of a lens from flights that look straight down, and whether what is stated of it covers the truth.

    python -m tests.benchmarks.lenses [--frames N] [--flights N]

Surveys at one height whose matches are computed, not seen: lenses from 0.6 to 4 half-diagonals, at several spreads of tilt, over
flat ground and over a village. The village has houses, low hills, wrong matches, a rolling shutter and a lens that is a little
off its axis: all that pulls at a lens and is not modelled. Rows: the median error of the focal length, the largest error in
stated deviations, the median stated deviation, and how many lenses were refused, over some flights each.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.stitch.arrays import Array, Indices
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera.projection import rotations

WIDTH, HEIGHT = 1920, 1080
HALF = math.hypot(WIDTH, HEIGHT) / 2
SIDES = np.array([WIDTH, HEIGHT]) / HALF / 2  # half of them, half-diagonals
SCALE = 1.66  # full-resolution pixels per pixel of the feature picture: that has 0.75 MP
FOCALS = (0.6, 0.8, 1.1, 1.5, 2.0, 3.0, 4.0)  # half-diagonals
TILTS = (0.0, 0.5, 1.0, 2.0, 4.0)  # degrees
FORWARD, SIDE = 0.75, 0.65  # overlaps
PER_FRAME, PER_PAIR, LINKS = 400, 24, 12  # points of a frame, matches of a pair, links of a frame
FEWEST = 30  # common points of a pair
ROUNDS = 3  # adjustments, each at the heights that the one before has found
SHUTTER_STEPS = 3  # until a point's line is that of its time


@dataclass(frozen=True, slots=True, kw_only=True)
class NadirFlight:
    """Angles in degrees; lengths in flying heights, pixels of the feature picture where stated."""

    focal: float  # half-diagonals
    tilt: float = 0.0  # standard deviation of pitch and roll
    frames: int = 100
    crossed: bool = False  # two surveys across each other
    seed: int = 1
    noise_px: float = 0.5
    houses: float = 0.0  # share of points on roofs
    roofs: float = 0.05  # height of the highest
    hills: float = 0.0  # standard deviation of heights
    wrong: float = 0.0  # share of matches that are wrong by some pixels
    readout: float = 0.0  # of a footprint's length, flown while a frame is read out line by line
    shaking: float = 0.0  # radians turned meanwhile, standard deviation
    k1: float = 0.0
    tangential: tuple[float, float] = (0.0, 0.0)


def village(focal: float, tilt: float, seed: int, frames: int = 100) -> NadirFlight:
    """A flight with all that is not modelled."""
    return NadirFlight(
        **{"focal": focal, "tilt": tilt, "seed": seed, "frames": frames, "crossed": seed % 2 == 0},  # type: ignore[arg-type]
        **{"houses": 0.3, "hills": 0.02, "wrong": 0.05, "readout": 0.003, "shaking": 0.001, "k1": -0.012},  # type: ignore[arg-type]
        tangential=(3e-4, -3e-4),
    )


def flown(flight: NadirFlight) -> Problem:
    """What a flight's adjustment is given: its matches, rough poses, and any lens."""
    rng = np.random.default_rng(flight.seed)
    route = _route(flight)
    poses = _poses(flight, route, rng)
    ground = _ground(flight, route, rng)
    seen = [_seen(flight, pose, course, ground, rng) for pose, course in zip(poses, route[:, 2], strict=True)]
    pairs, sides = [], []
    for pair in sorted(_near(poses)):
        common, first, second = np.intersect1d(seen[pair[0]][0], seen[pair[1]][0], return_indices=True)
        if len(common) >= FEWEST:
            chosen = rng.permutation(len(common))[:PER_PAIR]
            a, b = seen[pair[0]][1][first[chosen]], seen[pair[1]][1][second[chosen]]
            lost = rng.random(PER_PAIR) < flight.wrong
            pairs.append(pair)
            sides.append((a, b + rng.normal(0, 4 * SCALE / HALF, b.shape) * lost[:, None]))
    rough = poses + rng.normal(0, 0.01, poses.shape) * [1 / flight.focal, 1 / flight.focal, 1, 1, 0, 0]
    rough[:, :2] *= HALF * flight.focal  # pixels of the first frame
    rough[:, 4:] = 0
    a, b = (np.array(side) for side in zip(*sides, strict=True))
    return Problem(
        poses=rough,
        lenses=np.array([[math.log(AdjustmentSettings().focal_prior), 0.0, 0.0, 0.0, 0.0]]),
        camera=np.zeros(len(poses), int),
        half_diagonal=np.array([HALF]),
        unit_px=np.array([HALF / SCALE]),
        pairs=np.array(pairs),
        pixels_a=a,
        pixels_b=b,
        present=np.ones(a.shape[:2], bool),
        free=np.ones(len(poses), bool),
    )


def adjusted(problem: Problem, rounds: int = ROUNDS) -> Solution:
    """Adjusted again and again, as islands are."""
    settings = AdjustmentSettings()
    for _ in range(rounds):
        height = HALF * math.exp(problem.lenses[0, 0] + np.median(problem.poses[:, 2]))
        solution = adjust(replace(problem, relief=settings.relief.sigma * height), settings)
        problem = replace(problem, poses=solution.poses, lenses=solution.lenses)
    return solution


def error_and_deviation(solution: Solution, focal: float) -> tuple[float, float]:
    """Of the log of the focal length: its error, and its stated standard deviation."""
    assert solution.lens_covariances is not None, "the matches of a survey leave nothing open"
    return float(solution.lenses[0, 0]) - math.log(focal), math.sqrt(solution.lens_covariances[0, 0, 0])


def _footprint(flight: NadirFlight) -> Array:
    return 2 * SIDES / flight.focal


def _route(flight: NadirFlight) -> Array:
    """Lines flown there and back: places and courses (n, 3)."""
    count = flight.frames // 2 if flight.crossed else flight.frames
    lines = _lines(flight, count)
    if not flight.crossed:
        return lines
    across = _lines(flight, flight.frames - count)[:, [1, 0, 2]] - [0, 0, math.pi / 2]
    across[:, :2] += lines[:, :2].mean(axis=0) - across[:, :2].mean(axis=0)
    return np.concatenate([lines, across])


def _lines(flight: NadirFlight, count: int) -> Array:
    spacing, step = _footprint(flight) * [1 - SIDE, 1 - FORWARD]
    per_line = -(-count // max(1, round(math.sqrt(count * step / spacing))))
    line, place = np.divmod(np.arange(count), per_line)
    back = line % 2 == 1
    return np.asarray(
        np.stack([line * spacing, np.where(back, per_line - 1 - place, place) * step, back * math.pi], axis=1)
    )


def _poses(flight: NadirFlight, route: Array, rng: np.random.Generator) -> Array:
    """True poses (n, 6), lengths in flying heights."""
    n, tilt = len(route), math.radians(flight.tilt)
    shaken = rng.normal(0, 1, (n, 6)) * [0.03 / flight.focal, 0.03 / flight.focal, 0.005, 0.05, tilt, tilt]
    return np.asarray(np.c_[route[:, :2], np.zeros(n), route[:, 2], np.zeros((n, 2))] + shaken)


def _ground(flight: NadirFlight, route: Array, rng: np.random.Generator) -> Array:
    """Points (m, 3) of the ground, and their heights."""
    footprint = _footprint(flight)
    low, high = route[:, :2].min(axis=0) - footprint, route[:, :2].max(axis=0) + footprint
    places = rng.uniform(low, high, (int(PER_FRAME * np.prod((high - low) / footprint)), 2))
    waves = rng.normal(0, 2 * math.pi / (6 * footprint[0]), (2, 6)), rng.uniform(0, 2 * math.pi, 6)
    hills = flight.hills * math.sqrt(2 / 6) * np.sin(places @ waves[0] + waves[1]).sum(axis=1)
    block = np.floor(places / 0.1).astype(int) @ [7919, 104729] % 9973
    roofs = rng.uniform(0.3, 1.0, 9973)[block] * flight.roofs * (rng.random(len(places)) < flight.houses)
    return np.asarray(np.c_[places, hills + roofs])


def _seen(
    flight: NadirFlight, pose: Array, course: float, ground: Array, rng: np.random.Generator
) -> tuple[Indices, Array]:
    """Numbers of the points that a frame shows, and where it does, half-diagonals from its middle."""
    reach = np.linalg.norm(_footprint(flight)) * 0.75
    near = np.flatnonzero((abs(ground[:, :2] - pose[:2]) < reach).all(axis=1))
    turned = rng.normal(0, flight.shaking, 3)
    flown_on = np.array([-math.sin(course), math.cos(course)]) * _footprint(flight)[1] * flight.readout
    time = np.zeros((len(near), 1))  # of the line that shows it, from the middle one, in readouts
    for _ in range(SHUTTER_STEPS):
        then = np.concatenate([time * flown_on, np.zeros_like(time), time * turned], axis=1) + pose
        rotation, _ = rotations(then)
        sight = np.c_[ground[near, :2] - then[:, :2], math.exp(pose[2]) - ground[near, 2]]
        pixels = _lens(flight, np.einsum("mji,mj->mi", rotation, sight))
        time = np.clip(pixels[:, 1:] / SIDES[1] / 2, -1, 1)
    pixels = pixels + rng.normal(0, flight.noise_px * SCALE / HALF, pixels.shape)
    inside = (abs(pixels) < SIDES).all(axis=1)
    return near[inside], pixels[inside]


def _lens(flight: NadirFlight, rays: Array) -> Array:
    x, y = (rays[:, :2] / rays[:, 2:]).T
    r2, (p1, p2) = x**2 + y**2, flight.tangential
    radial = 1 + flight.k1 * r2
    bent = [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y]
    return flight.focal * np.stack(bent, axis=1)


def _near(poses: Array) -> set[tuple[int, int]]:
    """Each frame with those nearest to it."""
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    nearest = np.argsort(apart, axis=1)[:, 1 : LINKS + 1]
    return {(min(i, j), max(i, j)) for i, others in enumerate(nearest.tolist()) for j in others}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.lenses", allow_abbrev=False)
    parser.add_argument("--frames", type=int, default=100, metavar="N", help="of each flight (100)")
    parser.add_argument("--flights", type=int, default=5, metavar="N", help="of each kind (5)")
    given = parser.parse_args()
    print("ground   tilt  focal   error   worst   stated  refused")
    for line in table(given.frames, given.flights):
        print(line, flush=True)


def table(frames: int, flights: int) -> Iterator[str]:
    """Rows as above."""
    for ground in ("flat", "village"):
        for tilt in TILTS:
            for focal in FOCALS:
                kinds = (
                    village(focal, tilt, seed, frames)
                    if ground == "village"
                    else NadirFlight(focal=focal, tilt=tilt, seed=seed, frames=frames)
                    for seed in range(flights)
                )
                solutions = [adjusted(flown(kind)) for kind in kinds]
                error, deviation = np.array([error_and_deviation(one, focal) for one in solutions]).T
                yield (
                    f"{ground:8} {tilt:4.1f} {focal:6.2f} {np.median(abs(error)):7.1%} {abs(error / deviation).max():7.1f} "
                    f"{np.median(deviation):8.3f} {sum(bool(one.refused[0]) for one in solutions):8}"
                )


if __name__ == "__main__":
    main()
