"""What stands out in an integral: hints, never a filter.

Of colours: RX (Reed and Yu, IEEE Trans. ASSP 38(10), 1990; on integrals: Nathan, Kurmi and Bimber, Remote Sensing 15(18), 2023),
the Mahalanobis distance of a pixel of the mean to the square around it, by the covariance of the whole picture. Noise falls with
the number of looks, which differs from pixel to pixel, so the distance is taken relative to that.

Of a single band, as of a thermal camera, only what is brighter than its surroundings counts: beneath a canopy people are warmer
than what is around them. There a mean is not the best that can be told: who is seen through a gap by three looks of twenty is
plain in these, and next to nothing in the mean of all. So each look is asked how much likelier its pixel is if something warm
lies there that it sees in a share of cases, against chance, and the logarithms are added (a contaminated normal: J. W. Tukey, "A
survey of sampling from contaminated distributions", 1960). A warm crown is so in one or two looks, since it lies elsewhere in
all others; what no look counts for more than is bounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST, as_grey
from gcs_mosaic.integral.forms import LEAST_LOOKS, looks_of, mean
from gcs_mosaic.integral.ground_lens import GroundLens
from gcs_mosaic.integral.stack import GroundWindow, LookStack
from gcs_mosaic.stitch.arrays import AnyArray, Array, FloatImage, Matrix

# In pixels of the integral, which are those of the looks.
CENTRE = 3  # smaller is noise
SURROUND = 41  # a few times a person
APART = 10  # two peaks nearer than that are one thing

NEAR = 13  # of warm things: what is around them, in pixels
# After the most halvings a body is at least CENTRE pixels wide; those before are for pieces of it, as gaps show them. Pixels of
# which people were 6 long found 3 of 9 in a simulated wood that hid 87 %.
BODY_M, PIECES = 0.5, 2
# Focuses searched below and above a height: where that is a guess it is of the lowest leaves, and the ground is below.
BELOW_KNOWN, BELOW_GUESS, ABOVE = 1, 8, 1
MOST_FOCUSES = 16
# How often the pixels are halved, where nobody knows how large a person is: 10 to 40 px long. Each size more lets chance in, too:
# in simulated woods that costs some people of a hundred (`tests.benchmarks.canopy`).
ANY_SIZE = (0, 1, 2)
MOST_HALVINGS = 4
# Chosen on seeds 1 and 2 of the benchmark's woods, at 70 % hidden; others are held out.
OPEN = 0.1  # share of looks that see what lies there
WARMTHS = (3.0, 5.0, 7.0)  # deviations of what is warm, each as likely: from partly hidden to plain
MOST_TOLD = 8.0  # deviations beyond which a look tells no more: one alone does not make a person
LEAST_SCALE = 0.1  # grey levels: of a picture without any noise
LEAST_DEPTH, MOST_DEPTH = 0.005, 0.03  # shares of the flying height between focuses that are searched


@dataclass(frozen=True, slots=True, kw_only=True)
class HotPlace:
    """A thing that stands out: its canvas place, the focus in which it does so most, and by how many standard deviations."""

    x: float
    y: float
    height: float
    score: float


def oddity(values: FloatImage, looks: Matrix) -> FloatImage:
    """RX of an integral (h, w, bands) with so many looks (h, w) of each pixel, in standard deviations; 0 where not known."""
    known = np.isfinite(values).all(axis=2) & (looks >= LEAST_LOOKS)
    if not known.any():
        return np.zeros(known.shape, np.float32)
    local = _blurred(values, known, CENTRE) - _blurred(values, known, SURROUND)
    local *= np.sqrt(looks / looks.max())[..., None]
    some = local[known]
    covariance = some.T @ some / len(some) + 1e-6 * np.eye(some.shape[1], dtype=np.float32)
    whitened = local @ np.linalg.inv(np.linalg.cholesky(covariance)).T.astype(np.float32)
    if whitened.shape[2] == 1:
        return np.where(known, np.maximum(whitened[..., 0], 0), 0).astype(np.float32)
    return np.where(known, np.sqrt((whitened * whitened).sum(axis=2)), 0).astype(np.float32)


def person_size(cell_m: float | None) -> Sequence[int]:
    """How often pixels are halved to find people, by how many metres one is wide; all that may be if that is not known."""
    if cell_m is None:
        return ANY_SIZE
    most = int(np.clip(math.floor(math.log2(BODY_M / (CENTRE * cell_m))), 0, MOST_HALVINGS))
    return tuple(range(max(0, most + 1 - PIECES), most + 1))


def warmth(stack: LookStack, sizes: Sequence[int] = ANY_SIZE) -> FloatImage:
    """How much likelier pixels (h, w) of looks of a single band are if something warm lies there, seen through gaps: as standard
    deviations, the root of twice the logarithm of the likelihood ratio; 0 where fewer than LEAST_LOOKS looks see it."""
    values, (height, width) = stack.values[..., 0], stack.values.shape[1:3]
    best = np.zeros((height, width), np.float32)
    for side in (2**halvings for halvings in sizes):
        small = max(width // side, 1), max(height // side, 1)
        total = np.zeros(small[::-1], np.float32)
        for look in values:
            total += _told_by(look if side == 1 else cv2.resize(look, small, interpolation=cv2.INTER_AREA))
        wide = total if side == 1 else cv2.resize(total, (width, height), interpolation=cv2.INTER_LINEAR)
        np.maximum(best, wide, out=best)
    known = looks_of(stack) >= LEAST_LOOKS
    return np.where(known, np.sqrt(2 * np.maximum(best, 0)), 0).astype(np.float32)


def _told_by(look: FloatImage) -> FloatImage:
    """Logarithm of the likelihood ratio that a look (h, w) alone gives; 0 where it sees nothing."""
    known = np.isfinite(look)
    if not known.any():
        return np.zeros(look.shape, np.float32)
    local = _blurred(look[..., None], known, CENTRE)[..., 0] - _blurred(look[..., None], known, NEAR)[..., 0]
    scale = 1.4826 * float(np.median(np.abs(local[known])))
    return np.where(known, _likelihoods()(local / max(scale, LEAST_SCALE)), 0).astype(np.float32)


@cache
def _likelihoods() -> Callable[[FloatImage], FloatImage]:
    """Logarithm of the likelihood ratio of one look, by its deviations: from a table."""
    at = np.arange(-MOST_TOLD, MOST_TOLD + 0.01, 0.05)
    warm = np.mean([np.exp(one * at - one * one / 2) for one in WARMTHS], axis=0)
    table = np.log(1 - OPEN + OPEN * warm)
    return lambda deviations: np.asarray(np.interp(deviations, at, table), np.float32)


def found_in(
    lens: GroundLens,
    height: float,
    opened: float,
    most: int,
    unit_m: float | None = None,
    guess: float | None = None,
    *,
    is_dark: bool = False,
) -> list[HotPlace]:
    """What stands out most in a lens, at a height and in some focuses about it: one of each thing. `guess`: the lower end of what
    agrees, where the ground was not found; it is sought far below that. `unit_m`: metres of a canvas unit, if that is known.
    `is_dark`: of a single band what is darker than its surroundings."""
    lens = in_one_band(lens)
    aperture = lens.aperture(height, opened)
    depth = min(max(aperture.depth, LEAST_DEPTH), MOST_DEPTH)
    sizes = person_size(None if unit_m is None else unit_m * lens.window.cell)
    found = list[HotPlace]()
    for share in _searched(height, guess, depth):
        if LOWEST <= share <= HIGHEST:
            stack = lens.stack(share, opened)
            odd = oddities(replace(stack, values=-stack.values) if is_dark else stack, sizes)
            found += peaks(odd, lens.window, share, most)
    return over_heights(found, APART * lens.window.cell, aperture.width / 2)[:most]


def _searched(height: float, guess: float | None, depth: float) -> Array:
    """Focuses, the lowest first, a `depth` apart, or farther where these were too many."""
    low = height - BELOW_KNOWN * depth if guess is None else min(height, guess) - BELOW_GUESS * depth
    high = height + ABOVE * depth
    return np.linspace(low, high, min(round((high - low) / depth) + 1, MOST_FOCUSES))


def in_one_band(lens: GroundLens) -> GroundLens:
    """The brightness alone of looks of which most are coloured by a palette that is brighter where it is warmer."""
    if 2 * sum(one.heat for one in lens.looks) <= len(lens.looks):
        return lens
    return replace(lens, looks=[as_grey(one) for one in lens.looks])


def oddities(stack: LookStack, sizes: Sequence[int] = ANY_SIZE) -> FloatImage:
    """How much pixels (h, w) of a stack stand out, in standard deviations: by warmth of a single band, else by RX."""
    return warmth(stack, sizes) if stack.values.shape[3] == 1 else oddity(mean(stack), looks_of(stack))


def peaks(odd: FloatImage, window: GroundWindow, height: float, most: int) -> list[HotPlace]:
    """The pixels (h, w) that stand out most among those near them, the oddest first."""
    around = cv2.dilate(odd, np.ones((2 * APART + 1,) * 2, np.uint8))
    rows, columns = np.nonzero((odd >= around) & (odd > 0))
    order = np.argsort(-odd[rows, columns], kind="stable")[:most]
    return [_hot(odd, window, height, int(rows[one]), int(columns[one])) for one in order]


def over_heights(found: Iterable[HotPlace], reach: float, aside: float) -> list[HotPlace]:
    """One of each thing that stands out in several focuses, the oddest first. `reach`: canvas units between two that are one;
    `aside`: by how much more two are for a flying height between their focuses, as of looks from one side, at which a thing out
    of focus lies aside of where it is."""
    kept: list[HotPlace] = []
    for one in sorted(found, key=lambda hot: -hot.score):
        apart = ((math.hypot(one.x - other.x, one.y - other.y), abs(one.height - other.height)) for other in kept)
        if all(away > reach + aside * between for away, between in apart):
            kept.append(one)
    return kept


def _hot(odd: FloatImage, window: GroundWindow, height: float, row: int, column: int) -> HotPlace:
    x, y = window.place_of(column, row)
    return HotPlace(x=x, y=y, height=height, score=float(odd[row, column]))


def _blurred(values: FloatImage, known: AnyArray, side: int) -> FloatImage:
    """Means of the known pixels in squares (h, w, bands); 0 where there are none."""
    weight = known.astype(np.float32)
    total = cv2.blur(np.where(known[..., None], values, 0).astype(np.float32), (side, side)).reshape(values.shape)
    share = cv2.blur(weight, (side, side))[..., None]
    return np.asarray(np.where(known[..., None], total / np.maximum(share, 1e-6), 0), np.float32)
