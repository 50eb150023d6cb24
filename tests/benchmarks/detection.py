"""Whether the stated probability of detection is met: python -m tests.benchmarks.detection [--fit] [--keep DIR]

Simulated flights with people of known place, posture and clothes, in the sun, in the shade and under leaves, in sharp and in
smeared pictures. What would be stated is told from the pictures without people; the reader of fixed rule (see `detection.model`)
looks at those with people. Printed: how often it found whom it should have found with 0 to 10 %, 10 to 20 %, ... (reliability
diagram). With --fit the coefficients are fitted to some scenes and written; those held out, of other grounds and seeds, are
never fitted to.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gcs_mosaic.detection.clutter import (
    FilteredPicture,
    GroundStatistics,
    disagreement,
    filtered,
    scores,
    statistics,
)
from gcs_mosaic.detection.looks import look_at
from gcs_mosaic.detection.model import (
    DIRECTION_DEG,
    EACH,
    TABLE,
    Coefficients,
    coefficients,
    kept_contrast,
    of_look,
    open_to_view,
    through_leaves,
    together,
    written,
)
from gcs_mosaic.detection.persons import CLOTHES, COLOURS, POSTURES, SIZES_M, Person
from gcs_mosaic.stitch.features.sharpness import sharpness
from gcs_mosaic.views.sharpness import relative_sharpness
from sitl.camera import Scene, expose
from sitl.flight import Flight, plan
from sitl.geometry import CameraState, Lens, ground_from_pixels, pixels_from_ground, rays_of_picture
from sitl.ground.noise import fractal
from sitl.path import Plan
from sitl.targets import Target, paint_targets

SIZE = (560, 420)
PEOPLE = 90  # of each flight, at most
APART_M = 3.5
FRAMES = 6
SMEARS = (0, 0, 0, 0, 2, 4, 8)  # px of motion, drawn for each frame
SHADE, SHADED = 0.4, 0.9  # of the sun's light; deviations of noise above which there is shade
LEAVES_FROM = 1.0  # metres over the ground: what is higher hides who lies below
PER_LOOK = ("most", "offset", "contrast", "blur", "leaves_offset", "leaves", "leaves_share")
FLIGHT = 100_000  # numbers of people of a flight
MESH = 12  # columns and rows over which a picture is laid on another
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A flight's ground, its seed, height (m), share of leaves, and whether things stand on it."""

    ground: str
    seed: int
    height: float
    leaves: float = 0.0
    relief: float = 0.0


FITTED = (
    Setting(ground="country", seed=1, height=30),
    *(Setting(ground="floor", seed=2, height=30, leaves=leaves) for leaves in (0.6, 0.0, 0.85, 0.3)),
    *(Setting(ground="country", seed=1, height=height) for height in (55, 95, 120)),
    *(Setting(ground="snow", seed=1, height=height) for height in (40, 80)),
    Setting(ground="floor", seed=2, height=60, leaves=0.5),
    Setting(ground="suburb", seed=1, height=30),
    Setting(ground="woods", seed=5, height=40, relief=1.0),
    Setting(ground="rows", seed=4, height=40),
    *(Setting(ground="suburb", seed=1, height=height) for height in (55, 95)),
    Setting(ground="cars", seed=4, height=40),
)
HELD_OUT = (
    Setting(ground="country", seed=11, height=25),
    *(Setting(ground="floor", seed=13, height=40, leaves=leaves) for leaves in (0.45, 0.7, 0.15)),
    *(Setting(ground="country", seed=11, height=height) for height in (45, 75, 105)),
    *(Setting(ground="halls", seed=12, height=height) for height in (35, 70)),
    Setting(ground="berries", seed=12, height=35),
    Setting(ground="woods", seed=16, height=50, relief=1.0),
    *(Setting(ground="lake", seed=12, height=height) for height in (35, 60)),
    Setting(ground="snow", seed=12, height=50),
)


@dataclass(frozen=True)
class Looks:
    """Of looks (n,) at people: whose, what is known, whether the reader found it. `direction`: number of a square of
    directions."""

    person: Floats
    in_sun: Floats
    in_shade: Floats
    kept: Floats
    texture: Floats
    disagreement: Floats
    direction: Floats
    found: Floats


@dataclass(frozen=True)
class Sought:
    """Someone on the ground."""

    target: Target
    person: Person


def crowd(flight: Flight, seed: int) -> list[Sought]:
    """People over the ground that the flight sees, of all postures and clothes."""
    rng, lens = np.random.default_rng([seed, 77]), flight.scene.camera.lens
    found: list[Sought] = []
    kinds = [(posture, clothes) for posture in POSTURES for clothes in CLOTHES]
    pixels = rng.uniform(0.05, 0.95, (400, 2)) * [lens.width, lens.height]
    spots = np.concatenate([ground_from_pixels(lens, state, pixels) for state in flight.states])
    for x, y in rng.permutation(spots).tolist():
        if len(found) == PEOPLE:
            break
        posture, clothes = kinds[len(found) % len(kinds)]
        length, width = SIZES_M[posture]
        heading = float(rng.uniform(0, 2 * np.pi))
        person = Person(posture=posture, clothes=clothes)
        target = Target(kind="person", x=x, y=y, length=length, width=width, heading=heading, colour=COLOURS[clothes])
        if all(abs(x - one.target.x) + abs(y - one.target.y) > APART_M for one in found):
            found.append(Sought(target, person))
    return found


def on_the_floor(lens: Lens, state: CameraState, ground: Floats) -> Floats:
    return np.asarray(pixels_from_ground(lens, state, ground), np.float64)


class Peopled:
    """Pictures of a flight without and with people."""

    def __init__(self, setting: Setting, cache: Path | None = None) -> None:
        self.flight = plan(
            "survey",
            SIZE,
            seed=setting.seed,
            ground=setting.ground,
            relief=setting.relief,
            leaves=setting.leaves,
            cache=cache,
            route=Plan(frames=FRAMES, height=setting.height, forward=0.7, side=0.55),
        )
        self.canopy = self.flight.scene.canopy
        self.scene: Scene = replace(self.flight.scene, canopy=None)
        self.people = crowd(self.flight, setting.seed)
        self.shade = fractal(np.random.default_rng([setting.seed, 78]), 512, coarsest=64, finest=16)
        self.smears = np.random.default_rng([setting.seed, 79]).choice(SMEARS, len(self.flight.states))

    def pictures(self, index: int) -> list[NDArray[np.uint8]]:
        """(without, with) of a frame."""
        state, lens = self.flight.states[index], self.scene.camera.lens
        rays = rays_of_picture(lens)
        empty = self.scene.light(state)
        peopled = empty.copy()
        targets = [one.target for one in self.people]
        paint_targets(
            peopled, targets, state, lambda at, ground: on_the_floor(lens, at, np.asarray(ground, np.float64))
        )
        x, y, height = self.scene.seen(state, rays)
        if self.scene.relief:
            above = height > LEAVES_FROM
            peopled[above] = empty[above]
        column, row = (np.asarray(place / 0.5 % 512, np.float32) for place in (x, y))
        shade = cv2.remap(self.shade, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        light = np.where(shade > SHADED, SHADE, 1).astype(np.float32)[..., None]
        found = []
        for one in (empty, peopled):
            one *= light
            if self.canopy is not None:
                self.canopy.cover(one, state, rays)
            if self.smears[index]:
                one = np.asarray(cv2.blur(one, (1, int(self.smears[index]) + 1)), np.float32)
            counts = expose(self.scene.camera, one, 1.0, self.scene.chance(index))
            data = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, self.scene.camera.quality])[1]
            found.append(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8))
        return found


@dataclass(frozen=True)
class Measured:
    """A frame for one posture, without and with people."""

    empty: FilteredPicture
    ground: GroundStatistics
    reader: NDArray[np.float32]  # scores with people
    clutter: NDArray[np.float32]  # scores without


def measured(setting: Setting, cache: Path | None = None) -> Looks:
    """All looks of a flight; `cache`: folder of painted worlds."""
    peopled = Peopled(setting, cache)
    flight, lens = peopled.flight, peopled.scene.camera.lens
    pictures = [peopled.pictures(index) for index in range(len(flight.states))]
    shares = sharpness_of(flight, [one for one, _ in pictures])
    rows: list[Floats] = []
    for posture in POSTURES:
        side_px = Person(posture=posture).side_m * lens.focal_px / setting.height
        frames = [_measured(empty, full, side_px) for empty, full in pictures]
        threshold = _threshold(frames)
        for index, frame in enumerate(frames):
            differs = _differs(flight, frames, index)
            rows += _rows(peopled, index, frame, differs, shares[index], posture, threshold)
    table = np.array(rows)
    return Looks(*table.T)


def sharpness_of(flight: Flight, pictures: Sequence[NDArray[np.uint8]]) -> Floats:
    """Of each frame, beside those around."""
    lens = flight.scene.camera.lens
    corners = np.array([(0, 0), (lens.width, 0), (lens.width, lens.height), (0, lens.height)], float)
    outlines = np.array([ground_from_pixels(lens, state, corners) for state in flight.states])
    boxes = np.hstack([outlines.min(axis=1), outlines.max(axis=1)])
    return relative_sharpness(np.zeros(len(boxes), int), boxes, [sharpness(one) for one in pictures])


def _measured(empty: NDArray[np.uint8], full: NDArray[np.uint8], side_px: float) -> Measured:
    one, other = filtered(empty, side_px), filtered(full, side_px)
    ground = statistics(one)
    return Measured(one, ground, scores(other, statistics(other).covariances), scores(one, ground.covariances))


def _threshold(frames: Sequence[Measured]) -> float:
    """What the pictures without people exceed once in `EACH` places."""
    every = np.concatenate([one.clutter[:: one.empty.side, :: one.empty.side].ravel() for one in frames])
    return float(np.quantile(every, 1 - 1 / EACH))


def _differs(flight: Flight, frames: Sequence[Measured], index: int) -> Floats:
    """From the frame before (of the first: after)."""
    other = index - 1 if index else 1
    lens, one = flight.scene.camera.lens, frames[index]
    x, y = np.meshgrid(np.linspace(0, lens.width - 1, MESH), np.linspace(0, lens.height - 1, MESH))
    ground = ground_from_pixels(lens, flight.states[index], np.stack([x, y], axis=-1).reshape(-1, 2))
    there = pixels_from_ground(lens, flight.states[other], ground).reshape(MESH, MESH, 2)
    scale = frames[other].empty.scale
    step = round(one.ground.step_px * one.empty.scale)
    return disagreement(one.empty, frames[other].empty, np.asarray((there + 0.5) * scale - 0.5, np.float32), step)


def _rows(
    peopled: Peopled,
    index: int,
    frame: Measured,
    differs: Floats,
    sharp: float,
    posture: str,
    threshold: float,
) -> Iterator[Floats]:
    lens, state = peopled.scene.camera.lens, peopled.flight.states[index]
    for number, one in enumerate(peopled.people):
        place = np.array([[one.target.x, one.target.y]])
        pixel = on_the_floor(lens, state, place)
        if one.person.posture != posture or not ((pixel > 0) & (pixel < [lens.width - 1, lens.height - 1])).all():
            continue
        look = look_at(frame.ground, differs, pixel, one.person)
        away = float(np.hypot(*(place[0] - [state.x, state.y])))
        side_px = one.person.side_m * lens.focal_px / state.height / (1 + (away / state.height) ** 2) ** 0.75
        kept = kept_contrast(np.array([side_px]), np.array([sharp if np.isfinite(sharp) else 1.0]))
        column, row = (pixel[0] + 0.5) * frame.empty.scale - 0.5
        reach = frame.empty.side / 2 + 0.5
        box = frame.reader[
            max(0, round(row - reach)) : round(row + reach) + 1,
            max(0, round(column - reach)) : round(column + reach) + 1,
        ]
        east, south = np.degrees(np.arctan2(place[0] - [state.x, state.y], state.height))
        squares = np.floor([east / DIRECTION_DEG, south / DIRECTION_DEG])
        values = (number, look.in_sun, look.in_shade, kept, look.texture, look.disagreement, squares @ [1000, 1])
        yield np.array([*(float(np.squeeze(value)) for value in values), float(box.max(initial=0) > threshold)])


def opened(looks: Looks, fitted: Coefficients) -> Floats:
    """As of `open_to_view`; where that is not known as of the same place's other looks, else as of the flight's."""
    found = open_to_view(looks.disagreement, looks.texture, fitted)
    known = np.isfinite(found)
    for whose in (looks.person, looks.person // FLIGHT):
        _, group = np.unique(whose, return_inverse=True)
        count = np.bincount(group, known)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(group, np.where(known, found, 0)) / count
        found, known = np.where(known, found, mean[group]), known | (count[group] > 0)
    return np.where(known, found, 1.0)


def stated(looks: Looks, fitted: Coefficients) -> tuple[Floats, Floats]:
    """Of each person: the stated probability of all looks together, and whether the reader found it in any."""
    single = 0.5 * sum(of_look(one, looks.kept, fitted) for one in (looks.in_sun, looks.in_shade))
    is_open = opened(looks, fitted)
    _, whose = np.unique(looks.person, return_inverse=True)
    count = whose.max() + 1
    best, missed, found = np.zeros(count), np.zeros(count), np.zeros(count)
    np.maximum.at(best, whose, single)
    np.add.at(missed, whose, np.log1p(-np.minimum(single, 1 - 1e-9)))
    np.maximum.at(found, whose, looks.found)
    mean_open = np.bincount(whose, is_open) / np.bincount(whose)
    pairs = np.unique(np.stack([whose, looks.direction], axis=-1), axis=0)
    directions = np.bincount(pairs[:, 0].astype(int), minlength=count)
    seen = through_leaves(mean_open, np.asarray(directions, np.float64), fitted)
    return np.asarray(together(best, missed, fitted) * seen), found


def fit(looks: Looks) -> Coefficients:
    """By maximum likelihood: first each look by itself, then how they come together."""
    start = np.array([0.9, -1.5, 2.5, 2.5, 4.0, -1.5, -0.7])

    def of_one(values: Floats) -> Coefficients:
        return Coefficients(**dict(zip(PER_LOOK, values.tolist(), strict=True)), again=0.5, through=0.5)

    def single_cost(values: Floats) -> float:
        one = of_one(values)
        if not 0 < one.most <= 1:
            return 1e3
        chance = 0.5 * sum(of_look(each, looks.kept, one) for each in (looks.in_sun, looks.in_shade))
        chance = chance * opened(looks, one)
        return _cost(chance, looks.found) + 1e-4 * float((values - start) @ (values - start))

    one = of_one(minimize(single_cost, start, method="Nelder-Mead", options={"maxiter": 4000, "maxfev": 4000}).x)

    def joint_cost(values: Floats) -> float:
        again, through = 1 / (1 + np.exp(-values))
        return _cost(*stated(looks, replace(one, again=float(again), through=float(through))))

    again, through = 1 / (1 + np.exp(-minimize(joint_cost, np.zeros(2), method="Nelder-Mead").x))
    return replace(one, again=float(again), through=float(through))


def _cost(chance: Floats, found: Floats) -> float:
    chance = np.clip(chance, 1e-3, 1 - 1e-3)
    return -float(np.mean(found * np.log(chance) + (1 - found) * np.log(1 - chance)))


def reliability(chance: Floats, found: Floats) -> list[tuple[float, float, int]]:
    """For each tenth: stated, found, how many."""
    tenth = np.minimum((chance * 10).astype(int), 9)
    return [
        (float(chance[tenth == k].mean()), float(found[tenth == k].mean()), int((tenth == k).sum()))
        for k in range(10)
        if (tenth == k).any()
    ]


def error_of(rows: Sequence[tuple[float, float, int]]) -> float:
    """The mean distance of stated and found, each person counting once (expected calibration error)."""
    return sum(count * abs(one - other) for one, other, count in rows) / sum(count for *_, count in rows)


def told(name: str, looks: Looks, fitted: Coefficients) -> str:
    chance, found = stated(looks, fitted)
    rows = reliability(chance, found)
    lines = [f"{name}: {len(chance)} people, stated {chance.mean():.0%}, found {found.mean():.0%}"]
    lines += [f"  stated {one:4.0%} found {other:4.0%}, of {count}" for one, other, count in rows]
    return "\n".join([*lines, f"  error {100 * error_of(rows):.1f} points"])


def looks_of(settings: Sequence[Setting], keep: Path | None) -> Looks:
    """Of all flights, those kept in a folder used again."""
    tables = []
    for number, setting in enumerate(settings):
        name = f"{setting.ground}-{setting.seed}-{setting.height:g}-{setting.leaves:g}.npy"
        if keep is not None and (keep / name).exists():
            table = np.load(keep / name)
        else:
            began, one = time.monotonic(), measured(setting, keep)
            table = np.array([getattr(one, field) for field in Looks.__dataclass_fields__])
            print(f"{setting}: {table.shape[1]} looks, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
            if keep is not None:
                np.save(keep / name, table)
        tables.append(np.vstack([table[:1] + FLIGHT * number, table[1:]]))
    return Looks(*np.hstack(tables))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.detection")
    parser.add_argument("--fit", action="store_true", help="fit the coefficients and write them")
    parser.add_argument("--keep", type=Path, help="folder for what was measured, which is used again")
    given = parser.parse_args()
    if given.fit:
        looks = looks_of(FITTED, given.keep)
        TABLE.write_text(written(fit(looks)), encoding="utf-8")
        coefficients.cache_clear()
        print(told("fitted", looks, coefficients()))
    held_out = looks_of(HELD_OUT, given.keep)
    print(TABLE.read_text(encoding="utf-8"), end="")
    print(told("held out", held_out, coefficients()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
