"""The range in which a camera's counts are displayed, from all its frames: a hot roof, a shutter or a fire in one of them must
neither decide it nor leave the others in one grey.

Most of the counts between a camera's coldest and warmest pixel may occur nowhere: tarmac lies thousands of counts above a meadow
that spans a hundred. Such gaps are given little of the range, so that what lies on either side is seen, and nothing is clipped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import Bands, Vector
from gcs_mosaic.stitch.camera.bands import counts_of_ground

SAMPLE = 200_000  # maximum number of pixels of a frame that are sampled
DARK, BRIGHT = 0.005, 0.995  # quantiles; beyond them are dead pixels, glints and fires
SHARES = 33  # quantiles kept of a frame, from DARK to BRIGHT
INNER = 2  # of them at either end that do not tell how far above zero a frame's counts are: dead lines are zero
HEADROOM = 0.25  # of the range between them, reserved for later frames: aerial frames are similar to each other
LEAST_RANGE = 16  # counts; less is sensor noise
OUTLIERS = 0.1  # share of frames whose brightest pixels may be clipped, where counts begin near zero
RARE = 0.2  # share of all pixels; what is rarer gets less of the range, in proportion
MOST = 65_535  # counts
GAP = 0.25  # of all counts that occur; more of them in a row without a pixel is a gap
GAPS = 0.125  # of the range for all gaps together

Sketch = tuple[tuple[float, ...], ...]  # quantiles of a frame's counts, by band
Knot = tuple[float, float]  # count, level
Knots = tuple[tuple[Knot, ...], ...]  # by band
Counts = NDArray[np.floating]
Quantiles = NDArray[np.float64]  # (frames, SHARES) of one band
Range = tuple[float, float, tuple[Knot, ...]]


def sample_of(image: Bands) -> Bands:
    """Pixels spread over an image (h, w, bands), at most about SAMPLE."""
    step = max(1, int(np.sqrt(image.shape[0] * image.shape[1] / SAMPLE)))
    return np.ascontiguousarray(image[::step, ::step])


def sketch_of(image: Bands) -> Sketch:
    """The quantiles of what an image (h, w, bands) shows of the ground."""
    found = np.quantile(counts_of_ground(sample_of(image)), np.linspace(DARK, BRIGHT, SHARES), axis=0)
    return tuple(tuple(band) for band in found.T.tolist())


def fitted_range(sketches: Sequence[Sketch], count: int) -> tuple[tuple[int, ...], tuple[int, ...], Knots]:
    """Black, white and knots of each of `count` bands, from all frames of a camera; those of 8 bits without any.

    Three bands are a colour image and share one range. Black is the sensor's zero unless the counts of most frames are far above
    it, as from thermal cameras: then most of the range would be unused.
    """
    if not sketches:
        return (0,) * count, (255,) * count, ()
    seen = np.array(sketches)  # (frames, bands, SHARES)
    far = [are_far_above_zero(seen[:, band]) for band in range(count)]
    if count == 3 and not all(far):
        far = [False] * count
    ranges = [_of_far(seen[:, band]) if far[band] else _from_zero(seen[:, band]) for band in range(count)]
    black, white = [round(one[0]) for one in ranges], [min(round(one[1]), MOST) for one in ranges]
    if count == 3:
        return (min(black),) * count, (max(white),) * count, ()
    knots = tuple(one[2] for one in ranges)
    return tuple(black), tuple(white), knots if any(knots) else ()


def are_far_above_zero(seen: Quantiles) -> bool:
    """Whether most frames' counts are far above zero relative to what they span."""
    dark, bright = seen[:, INNER], seen[:, -1 - INNER]
    return bool(np.median(dark - 2 * (bright - dark)) >= 0)


def _from_zero(seen: Quantiles) -> Range:
    """Above the brightest of most frames: a single one with a fire is clipped."""
    dark, bright = float(np.quantile(seen[:, 0], OUTLIERS)), float(np.quantile(seen[:, -1], 1 - OUTLIERS))
    return 0, max(bright + HEADROOM * max(bright - dark, LEAST_RANGE), LEAST_RANGE), ()


def _of_far(seen: Quantiles) -> Range:
    """From the coldest to the warmest of all frames, with what occurs spread over the range and what does not left out."""
    counts = np.sort(seen, axis=None)
    bounds = _bounds(counts)
    first, last = counts[bounds[:-1]], counts[bounds[1:] - 1]
    room, between = HEADROOM * np.maximum(last - first, LEAST_RANGE), first[1:] - last[:-1]
    low = first - np.r_[room[0], np.minimum(room[1:], between / 3)]
    high = last + np.r_[np.minimum(room[:-1], between / 3), room[-1]]
    widths = (high - low) * np.minimum(np.diff(bounds) / len(counts) / RARE, 1)
    gap = GAPS * float(widths.sum()) / max(len(widths) - 1, 1)
    ends = np.cumsum(widths + gap) - gap
    places, levels = (
        np.stack([above[:-1], below[1:]], 1).ravel() for above, below in ((high, low), (ends, ends - widths))
    )
    knots = zip(places.round(1).tolist(), (levels * (255 / ends[-1])).round(2).tolist(), strict=True)
    black = max(0.0, float(low[0]))
    return black, max(float(high[-1]), round(black) + LEAST_RANGE), tuple(knots)


def _bounds(counts: Vector) -> NDArray[np.intp]:
    """Where sorted counts begin that are apart from those before by a gap, and the end."""
    steps = np.diff(counts)
    gaps = np.zeros(len(steps), np.bool_)
    while True:
        occurring = max(float(steps[~gaps].sum()), LEAST_RANGE)
        found = steps > max(GAP * occurring, LEAST_RANGE)
        if (found == gaps).all():
            return np.asarray(np.r_[0, np.flatnonzero(gaps) + 1, len(counts)], np.intp)
        gaps = found
