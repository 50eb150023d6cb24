"""People beneath leaves: how much better an integral shows them than single frames do, by looks and by what leaves hide.

    python -m tests.benchmarks.canopy [--kind thermal|colour] [--hidden D ...] [--seeds SEED ...] [--poses true|own]

Surveys of 320x256 frames at 50 m with 30 looks at each place, of which 5, 10, 20 or 30 are taken, over a forest's floor beneath
leaves 4 to 12 m high that sway; 25 people lie and sit on a hectare. Contrast is what a person's middle differs from the ground
around, in standard deviations of that ground: the median over people in the integral (mean), over that in the best of the same
single frames, and what the statistical model of Kurmi, Schedl and Bimber (IEEE Sensors Journal 19(20), 2019) lets expect.
Recall is the share of people among the hints that stand out more than all but one false hint a hectare: by RX on the integral,
by RX on each of the same single frames, of which each place's most telling one counts, and by RX on one frame for each place.
`--poses own`: those of the map that is made of the frames, at the focus that is best for people. A seed takes about a minute of
computing for each share hidden.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

import sitl.flight
from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.integral.forms import FORMS, looks_of, mean
from gcs_mosaic.integral.hot_places import HotPlace, oddity, peaks
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid_together
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.geometry import CameraState, Lens, rays_of_picture, world_from_camera
from sitl.path import Plan
from sitl.targets import CLOTHES, Target
from sitl.thermal import ThermalCamera

SIZE = (320, 256)
HEIGHT = 50.0
LOOKS = (5, 10, 20, 30)
ALL_LOOKS = 30  # by the overlaps: ten along a line, three lines
FORWARD, SIDE = 0.9, 1 - 1 / 3
FRAMES = 210
# Which of six consecutive frames are taken for so many looks.
TAKEN = {5: {0}, 10: {0, 3}, 20: {0, 1, 3, 4}, 30: {0, 1, 2, 3, 4, 5}}
BLOCK, BLOCKS, MARGIN = 25.0, 4, 3.5  # metres: a hectare in blocks, each with a margin for the surroundings
APART = 20.0  # metres between people
LYING, SITTING = (1.7, 0.5), (0.6, 0.6)
# The thermal camera shows a quarter of the light as warmth, of the floor, which lies in the shade of the leaves, a third of that.
# People are warmer than the floor by 210 levels of light, some six standard deviations of the leaves' warmth (35 levels).
EVEN = 1 / 3
HOT = (330.0, 330.0, 330.0)
NEAR = 1.2  # metres between a hint and the person that it is of
MIDDLE, INNER, OUTER = 0.25, 1.3, 3.0  # metres: radii of what is taken for a person, and of the ring around
THERMAL = ThermalCamera(writing=False, spots=0, rim=0.0)

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scored:
    """What one way of looking gives: contrast of each person, and hints with whether they are of a person."""

    contrasts: list[float]
    best_single: list[float]
    hints: list[tuple[float, int | None]]  # score, number of the person
    single_hints: list[tuple[float, int | None]]
    one_hints: list[tuple[float, int | None]]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.canopy", allow_abbrev=False)
    parser.add_argument("--kind", choices=("thermal", "colour"), default="thermal")
    parser.add_argument("--hidden", type=float, nargs="+", default=(0.5, 0.7, 0.9))
    parser.add_argument("--seeds", type=int, nargs="+", default=(1, 2))
    parser.add_argument("--poses", choices=("true", "own"), default="true")
    parser.add_argument("--picture", type=Path, help="write the integrals of one person here")
    parser.add_argument("--speed", action="store_true", help="what a change of the focus costs instead")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    if asked.speed:
        speed()
        return
    print(
        "hidden looks | contrast: integral, best single, gain, model | recall at 1 false/ha: integral, all singles, one"
    )
    for hidden in asked.hidden:
        began = time.monotonic()
        flights = [planned(hidden, seed, asked.kind) for seed in asked.seeds]
        told(asked, hidden, flights)
        print(f"  {time.monotonic() - began:.0f} s", flush=True)


def speed() -> None:
    """Milliseconds of one core for a change of the focus: 30 looks of 12 MP in memory, a window of 400 px, by form."""
    rng, camera = np.random.default_rng(1), Camera(4000, 3000, k1=-0.04)
    poses = [
        Pose(float(x), float(y), 0.0, 0.1, 0.02, -0.02) for x in range(-1000, 1001, 400) for y in range(-800, 801, 400)
    ]
    window, looks = GroundWindow(0.0, 0.0, 400.0, 400), list[GroundLook]()
    for number, pose in enumerate(poses):
        x, y = pixels_at(pose, camera, None, np.zeros((1, 2)), 0.0)[0]
        left, top = float(max(0, x // 1 - 400)), float(max(0, y // 1 - 400))
        image = rng.random((800, 800, 3), np.float32) * 255
        looks.append(GroundLook(f"{number}", pose, camera, image, left=left, top=top))
    for name, form in FORMS.items():
        times = []
        for height in (0.0, 20.0, 40.0, 60.0, 80.0):
            began = time.process_time()
            form(laid_together(looks, window, height))
            times.append(1000 * (time.process_time() - began))
        print(f"{name:>9}: {np.median(times):4.0f} ms a change of the focus, {len(looks)} looks", flush=True)


def planned(hidden: float, seed: int, kind: str) -> sitl.flight.Flight:
    """The flight, not yet rendered."""
    route = Plan(frames=FRAMES, height=HEIGHT, speed=8.0, forward=FORWARD, side=SIDE)
    flight = sitl.flight.plan("survey", SIZE, seed=seed, ground="floor", leaves=hidden, world_size=2048, route=route)
    world = flight.scene.world
    if kind == "thermal":
        middle = np.mean(world.levels[-1])
        levels = [np.clip(middle + EVEN * (one - middle) + 0.5, 0, 255).astype(np.uint8) for one in world.levels]
        world = replace(world, levels=tuple(levels))
    return replace(flight, scene=replace(flight.scene, world=world, targets=people(seed, kind)))


def people(seed: int, kind: str) -> tuple[Target, ...]:
    """Who lie and sit, one on each square of a grid over the hectare."""
    rng = np.random.default_rng([seed, 40])
    along = (np.arange(5) - 2) * APART
    found = []
    for number, (x, y) in enumerate((x, y) for x in along for y in along):
        length, width = LYING if number % 2 else SITTING
        at, heading = rng.uniform(-4, 4, 2) + np.array([x, y]), float(rng.uniform(0, 2 * np.pi))
        colour = HOT if kind == "thermal" else CLOTHES[number % len(CLOTHES)]
        place = {"x": float(at[0]), "y": float(at[1]), "heading": heading}
        found.append(Target(kind="person", length=length, width=width, colour=colour, **place))
    return tuple(found)


def told(asked: argparse.Namespace, hidden: float, flights: Sequence[sitl.flight.Flight]) -> None:
    """One line for each number of looks, of all flights together."""
    gathered: dict[int, list[Scored]] = {count: [] for count in LOOKS}
    models: list[Model] = []
    for flight in flights:
        images = pictures(flight, asked.kind)
        models.append(model_of(flight, images))
        looks, unit, height = (own_looks if asked.poses == "own" else true_looks)(flight, images)
        for count in LOOKS:
            gathered[count].append(scored(taken(looks, count), flight.scene.targets, unit, height))
        if asked.picture:
            write_pictures(asked.picture, hidden, looks, flight.scene.targets[12], unit, height)
    print(f"  hidden as measured {np.mean([one.hidden for one in models]):.1%}")
    for count, found in gathered.items():
        print(f"  {hidden:.0%} {count:3d} | {line(found, count, models)}", flush=True)


def line(found: Sequence[Scored], count: int, models: Sequence[Model]) -> str:
    """Medians and recalls."""
    contrast = np.median([each for one in found for each in one.contrasts])
    single = np.median([each for one in found for each in one.best_single])
    expected = np.mean([one.contrast(count) for one in models])
    recalls = [recall([getattr(one, name) for one in found], [len(one.contrasts) for one in found]) for name in HINTS]
    shares = " ".join(f"{one:4.0%}" for one in recalls)
    return f"{contrast:5.2f} {single:5.2f} {contrast / single:5.2f} {expected:5.2f} | {shares}"


HINTS = ("hints", "single_hints", "one_hints")


def recall(hints: Sequence[list[tuple[float, int | None]]], people_of: Sequence[int]) -> float:
    """Share of people found above all but one false hint a hectare; each flight shows a hectare."""
    false = sorted((score for one in hints for score, whose in one if whose is None), reverse=True)
    least = false[len(hints)] if len(false) > len(hints) else -math.inf
    found = sum(len({whose for score, whose in one if whose is not None and score > least}) for one in hints)
    return found / sum(people_of)


@dataclass(frozen=True, slots=True)
class Model:
    """Means and variances of what frames show: leaves, the ground between them, and people in the open."""

    hidden: float
    leaves: tuple[float, float]
    ground: tuple[float, float]
    person: float

    def contrast(self, looks: int) -> float:
        """Of a person in the mean of independent looks: the ground's own texture is in focus and does not average out."""
        open_share = 1 - self.hidden
        apart = self.hidden * open_share * (self.leaves[0] - self.ground[0]) ** 2
        variance = open_share**2 * self.ground[1] + (apart + self.hidden * self.leaves[1]) / looks
        return open_share * abs(self.person - self.ground[0]) / math.sqrt(variance)


def model_of(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> Model:
    """Measured in some frames, by what is known to hide each pixel."""
    rays, canopy = rays_of_picture(flight.scene.camera.lens), flight.scene.canopy
    assert canopy is not None, "it is planned with leaves"
    shares = [(canopy.hides(flight.states[k], rays), images[k].mean(axis=2)) for k in range(0, len(images), 20)]
    hides, values = (np.concatenate([one[k].ravel() for one in shares]) for k in (0, 1))
    leaves, ground = values[hides > 0.9], values[hides < 0.1]
    bare = replace(flight.scene, canopy=None)
    person = np.mean([np.mean(one.colour) for one in flight.scene.targets])
    if images[0].shape[2] == 1:
        light = bare.light(flight.states[0]).mean()
        person = ground.mean() + THERMAL.contrast * (person - light)
    return Model(
        float(hides.mean()), (leaves.mean(), leaves.var()), (float(np.median(ground)), ground.var()), float(person)
    )


def pictures(flight: sitl.flight.Flight, kind: str) -> list[FloatImage]:
    """Grey levels (h, w, bands) of all frames."""
    found = list[FloatImage]()
    for index, state in enumerate(flight.states):
        if kind == "thermal":
            found.append(THERMAL.picture(cast(Any, flight.scene.light(state)), index)[..., None].astype(np.float32))
        else:
            found.append(flight.scene.picture(state, index).astype(np.float32))
    return found


def true_looks(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> tuple[list[GroundLook], Units, float]:
    """The looks where the cameras were, the metres of a canvas unit and so on, and the ground's height, canvas units."""
    lens = flight.scene.camera.lens
    gsd = HEIGHT / lens.focal_px
    camera = Camera(lens.width, lens.height, lens.focal, lens.k1)
    states = zip(flight.names, flight.states, images, strict=True)
    looks = [GroundLook(name, true_pose(state, lens, gsd), camera, image) for name, state, image in states]
    return looks, Units(np.array([[gsd, 0.0], [0.0, gsd]]), np.zeros(2)), 0.0


def true_pose(state: CameraState, lens: Lens, gsd: float) -> Pose:
    """On a canvas of `gsd` metres a unit."""
    r = world_from_camera(state)
    yaw, pitch, roll = math.atan2(r[1, 0], r[0, 0]), math.asin(-r[2, 0]), math.atan2(r[2, 1], r[2, 2])
    return Pose(state.x / gsd, state.y / gsd, math.log(state.height / gsd / lens.focal_px), yaw, pitch, roll)


@dataclass(frozen=True, slots=True)
class Units:
    """world = turn @ canvas + shift, metres."""

    turn: Floats
    shift: Floats

    @property
    def metres(self) -> float:
        return float(np.sqrt(abs(np.linalg.det(self.turn))))

    def world(self, x: float, y: float) -> Floats:
        return np.asarray(self.turn @ [x, y] + self.shift)

    def canvas(self, x: float, y: float) -> Floats:
        return np.asarray(np.linalg.solve(self.turn, np.array([x, y]) - self.shift))


def own_looks(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> tuple[list[GroundLook], Units, float]:
    """The looks where the map's own adjustment has the cameras, laid on the true ones for scoring alone."""
    mosaic = Mosaic()
    for name, image in zip(flight.names, images, strict=True):
        mosaic.add(np.repeat(image, 3 // image.shape[2], axis=2).astype(np.uint8), name)
    mosaic.adjust()
    placed, by_name = mosaic.placements(), dict(zip(flight.names, zip(flight.states, images, strict=True), strict=True))
    islands = [one.island for one in placed]
    placed = [one for one in placed if one.island == max(set(islands), key=islands.count)]
    looks = [GroundLook(one.name, one.pose, one.camera, by_name[one.name][1], one.relief) for one in placed]
    canvas = np.array([[one.pose.x, one.pose.y] for one in looks])
    world = np.array([[by_name[one.name][0].x, by_name[one.name][0].y] for one in looks])
    units = similarity(canvas, world)
    print(f"  own poses: {len(looks)} of {len(images)} frames on one island, focal {looks[0].camera.focal:.3f}", end="")
    print(f" (true {flight.scene.camera.lens.focal:.3f}), nadirs {residual(units, canvas, world):.2f} m off")
    above = math.exp(np.median([one.pose.log_gsd for one in looks])) * looks[0].camera.focal_px
    heights = np.linspace(-0.25, 0.15, 41) * above
    contrasts = [median_contrast(looks, flight.scene.targets, units, height) for height in heights]
    best = int(np.argmax(contrasts))
    print(f"  focus best at {heights[best] / above:.1%} of the flying height above the map's ground")
    return looks, units, float(heights[best])


def median_contrast(looks: Sequence[GroundLook], targets: Sequence[Target], units: Units, height: float) -> float:
    return float(np.median([person_contrast(looks, one, units, height)[0] for one in targets[::3]]))


def similarity(canvas: Floats, world: Floats) -> Units:
    """The turn, scale and shift that lay points (n, 2) on others best."""
    one, other = (places @ [1, 1j] for places in (canvas, world))
    middle, there = one.mean(), other.mean()
    factor = np.vdot(one - middle, other - there) / np.vdot(one - middle, one - middle)
    shift = there - factor * middle
    turn = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    return Units(turn, np.array([shift.real, shift.imag]))


def residual(units: Units, canvas: Floats, world: Floats) -> float:
    return float(np.sqrt((((canvas @ units.turn.T + units.shift) - world) ** 2).sum(axis=1).mean()))


def taken(looks: Sequence[GroundLook], count: int) -> list[GroundLook]:
    """Every so many, so that each place has `count` looks."""
    return [look for number, look in enumerate(looks) if number % 6 in TAKEN[count]]


def scored(looks: Sequence[GroundLook], targets: Sequence[Target], units: Units, height: float) -> Scored:
    """All people and hints of a hectare."""
    pairs = [person_contrast(looks, one, units, height) for one in targets]
    hints, singles, ones = list[HotPlace](), list[HotPlace](), list[HotPlace]()
    for window in blocks(units):
        near = [look for look in looks if may_see(look, window)]
        stack = laid_together(near, window, height)
        hints += inner(peaks(oddity(mean(stack), looks_of(stack)), window, height, 200), units, window)
        singles += inner(peaks(single_oddity(stack.values), window, height, 200), units, window)
        whole = int(np.isfinite(stack.values[..., 0]).sum(axis=(1, 2)).argmax())
        ones += inner(peaks(single_oddity(stack.values[whole : whole + 1]), window, height, 200), units, window)
    people_of = [named(one, targets, units) for one in (hints, singles, ones)]
    return Scored([one for one, _ in pairs], [single for _, single in pairs], *people_of)


def blocks(units: Units) -> Iterator[GroundWindow]:
    cells = round((BLOCK + 2 * MARGIN) / (HEIGHT / Lens(width=SIZE[0], height=SIZE[1]).focal_px))
    for x in (np.arange(BLOCKS) - (BLOCKS - 1) / 2) * BLOCK:
        for y in (np.arange(BLOCKS) - (BLOCKS - 1) / 2) * BLOCK:
            at = units.canvas(x, y)
            yield GroundWindow(float(at[0]), float(at[1]), (BLOCK + 2 * MARGIN) / units.metres, cells)


def may_see(look: GroundLook, window: GroundWindow) -> bool:
    """By distance alone."""
    reach = math.exp(look.pose.log_gsd) * look.camera.half_diagonal * 1.3 + window.side
    return math.hypot(look.pose.x - window.x, look.pose.y - window.y) < reach


def inner(found: Sequence[HotPlace], units: Units, window: GroundWindow) -> list[HotPlace]:
    """Those not on the margin, of which neighbouring blocks tell; on a canvas that is turned blocks are, too."""
    half = BLOCK / units.metres / 2
    return [one for one in found if max(abs(one.x - window.x), abs(one.y - window.y)) <= half]


def single_oddity(looks: NDArray[np.float32]) -> NDArray[np.float32]:
    """The most telling of single frames (n, h, w, bands) at each pixel."""
    two = np.full(looks.shape[1:3], 2.0)
    odd = np.zeros(looks.shape[1:3], np.float32)
    for values in looks:
        np.maximum(odd, oddity(values, two), out=odd)
    return odd


def named(hints: Sequence[HotPlace], targets: Sequence[Target], units: Units) -> list[tuple[float, int | None]]:
    """Scores, and whose they are. The second hint at one person is neither found again nor false."""
    places = np.array([one.place(0.0) for one in targets])
    found, known = list[tuple[float, int | None]](), set[int]()
    for one in sorted(hints, key=lambda hint: -hint.score):
        away = np.linalg.norm(places - units.world(one.x, one.y), axis=1)
        nearest = int(away.argmin())
        if away[nearest] > NEAR:
            found.append((one.score, None))
        elif nearest not in known:
            known.add(nearest)
            found.append((one.score, nearest))
    return found


def person_contrast(looks: Sequence[GroundLook], target: Target, units: Units, height: float) -> tuple[float, float]:
    """In the integral, and in the best single frame."""
    x, y = units.canvas(*target.place(0.0))
    cell = HEIGHT / Lens(width=SIZE[0], height=SIZE[1]).focal_px
    window = GroundWindow(float(x), float(y), 2 * OUTER / units.metres, round(2 * OUTER / cell))
    stack = laid_together([look for look in looks if may_see(look, window)], window, height)
    if len(stack.values) < 2:
        return 0.0, 1e-6
    return contrast(mean(stack), cell), max(contrast(one, cell) for one in stack.values)


def contrast(values: NDArray[np.float32], cell: float) -> float:
    """Of the middle of a picture (n, n, bands) to the ring around it, in standard deviations there; 0 where not seen."""
    along = (np.arange(len(values)) - (len(values) - 1) / 2) * cell
    away = np.hypot(*np.meshgrid(along, along))
    middle, ring = values[away < MIDDLE], values[(away > INNER) & (away < OUTER)]
    if not np.isfinite(middle).all() or np.isfinite(ring).mean() < 0.9:
        return 0.0
    apart = np.abs(middle.mean(axis=0) - np.nanmean(ring, axis=0)) / (np.nanstd(ring, axis=0) + 1e-3)
    return float(apart.max())


def write_pictures(
    folder: Path, hidden: float, looks: Sequence[GroundLook], who: Target, units: Units, height: float
) -> None:
    """The integral of all looks about one person, and of five, and one look."""
    folder.mkdir(parents=True, exist_ok=True)
    x, y = units.canvas(*who.place(0.0))
    window = GroundWindow(float(x), float(y), 30 / units.metres, 360)
    for count in (5, 20, 30):
        stack = laid_together([one for one in taken(looks, count) if may_see(one, window)], window, height)
        write(folder / f"{hidden:.0%}-{count}.png", mean(stack))
    whole = [one for one in stack.values if np.isfinite(one).all()]
    if whole:
        write(folder / f"{hidden:.0%}-1.png", whole[len(whole) // 2])


def write(path: Path, values: NDArray[np.float32]) -> None:
    low, high = np.nanquantile(values, (0.002, 0.999))
    levels = np.nan_to_num(np.clip((values - low) / max(high - low, 1e-3) * 255, 0, 255))
    cv2.imwrite(str(path), levels.astype(np.uint8))


if __name__ == "__main__":
    main()
