"""How well people are seen in integrals and single frames of `canopy`, and how many are found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.integral.forms import looks_of, mean
from gcs_mosaic.integral.hot_places import HotPlace, oddities, oddity, peaks, person_size
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack, laid_together
from sitl.geometry import Lens
from sitl.targets import Target
from tests.benchmarks.canopy_scene import HEIGHT, SIZE, Units

# Which of six consecutive frames are taken for so many looks; all of them are thirty: ten along a line, three lines.
TAKEN = {5: {0}, 10: {0, 3}, 20: {0, 1, 3, 4}, 30: {0, 1, 2, 3, 4, 5}}
BLOCK, BLOCKS, MARGIN = 25.0, 4, 3.5  # metres: a hectare in blocks, each with a margin for the surroundings
NEAR = 1.2  # metres between a hint and the person that it is of
MIDDLE, INNER, OUTER = 0.25, 1.3, 3.0  # metres: radii of what is taken for a person, and of the ring around
HIDDEN_LIMITS = (0.7, 0.8, 0.9, 1.0)
WAYS = ("warm", "any size", "mean", "singles", "one")
Hint = tuple[float, int | None]  # score, number of the person


@dataclass(frozen=True, slots=True)
class Scored:
    """Contrast of each person, in the integral and in the best single frame; and hints by each of WAYS: of looks together, of
    these where no size is known, of their mean by RX, of the most telling of the single frames at each place, of one frame for
    each place."""

    contrasts: list[float]
    best_single: list[float]
    hints: dict[str, list[Hint]]


def scored(looks: Sequence[GroundLook], targets: Sequence[Target], units: Units, height: float) -> Scored:
    """All people and hints of a hectare."""
    pairs = [person_contrast(looks, one, units, height) for one in targets]
    found: dict[str, list[HotPlace]] = {way: [] for way in WAYS}
    for window in blocks(units):
        stack = laid_together([look for look in looks if may_see(look, window)], window, height)
        for way, odd in odd_by_way(stack).items():
            found[way] += inner(peaks(odd, window, height, 200), units, window)
    hints = {way: named(every, targets, units) for way, every in found.items()}
    return Scored([one for one, _ in pairs], [single for _, single in pairs], hints)


def odd_by_way(stack: LookStack) -> dict[str, NDArray[np.float32]]:
    """How much each pixel (h, w) stands out. Single frames are judged as looks together are, one by one."""
    sizes = person_size(HEIGHT / Lens(width=SIZE[0], height=SIZE[1]).focal_px)
    each = [oddities(LookStack(["", ""], np.repeat(one[None], 2, axis=0)), sizes) for one in stack.values]
    whole = int(np.isfinite(stack.values[..., 0]).sum(axis=(1, 2)).argmax())
    return {
        "warm": oddities(stack, sizes),
        "any size": oddities(stack),
        "mean": oddity(mean(stack), looks_of(stack)),
        "singles": np.max(each, axis=0),
        "one": each[whole],
    }


def recall(hints: Sequence[list[Hint]], people_of: Sequence[int]) -> float:
    """Share of people found above all but one false hint a hectare; each flight shows a hectare."""
    false = sorted((score for one in hints for score, whose in one if whose is None), reverse=True)
    least = false[len(hints)] if len(false) > len(hints) else -math.inf
    found = sum(len({whose for score, whose in one if whose is not None and score > least}) for one in hints)
    return found / sum(people_of)


def taken(looks: Sequence[GroundLook], count: int) -> list[GroundLook]:
    """Every so many, so that each place has `count` looks."""
    return [look for number, look in enumerate(looks) if number % 6 in TAKEN[count]]


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


def named(hints: Sequence[HotPlace], targets: Sequence[Target], units: Units) -> list[Hint]:
    """Scores, and whose they are. The second hint at one person is neither found again nor false."""
    places = np.array([one.place(0.0) for one in targets])
    found, known = list[Hint](), set[int]()
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


def by_hiding(hints: Sequence[list[Hint]], hidden: Sequence[Sequence[float]]) -> dict[float, tuple[int, int]]:
    """People found and people there, by how much of them leaves hide: up to each limit."""
    false = sorted((score for one in hints for score, whose in one if whose is None), reverse=True)
    least = false[len(hints)] if len(false) > len(hints) else -math.inf
    found: dict[float, tuple[int, int]] = dict.fromkeys(HIDDEN_LIMITS, (0, 0))
    for one, shares in zip(hints, hidden, strict=True):
        known = {whose for score, whose in one if score > least}
        for number, share in enumerate(shares):
            limit = next(limit for limit in HIDDEN_LIMITS if share <= limit)
            found[limit] = found[limit][0] + (number in known), found[limit][1] + 1
    return found
