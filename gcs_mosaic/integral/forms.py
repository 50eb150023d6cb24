"""A stack of looks becomes one picture.

The mean is the synthetic aperture's photograph: what hides a place in a share D of N looks leaves 1 - D of its contrast, and
noise that falls with the square root of N. The median shows what at least half of the looks agree on, the darkest and brightest
look what any of them has seen (a hot body), the deviation where looks disagree: what lies out of focus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from gcs_mosaic.integral.stack import LookStack
from gcs_mosaic.stitch.arrays import FloatImage, Matrix

LEAST_LOOKS = 2  # of a pixel: what was seen once is a photograph, and is not shown as more


def looks_of(stack: LookStack) -> Matrix:
    """Number of looks of each pixel (h, w)."""
    return np.asarray(np.isfinite(stack.values[..., 0]).sum(axis=0), np.float32)


def mean(stack: LookStack) -> FloatImage:
    """(h, w, bands); NaN where fewer than LEAST_LOOKS looks see a pixel, as of all forms."""
    count = looks_of(stack)
    return _where_known(count, _mean(stack, count))


def median(stack: LookStack) -> FloatImage:
    """Of each band by itself; of an even number of looks the mean of the two in the middle."""
    count = looks_of(stack)
    ordered = np.sort(stack.values, axis=0)  # what is not seen comes last
    if len(ordered) and count.min() == len(ordered):  # several times as fast as gathering
        middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
        return _where_known(count, middle)
    seen = np.maximum(count, 1).astype(np.intp)
    low, high = (np.take_along_axis(ordered, ((seen - one) // 2)[None, ..., None], axis=0)[0] for one in (1, 0))
    return _where_known(count, (low + high) / 2)


def darkest(stack: LookStack) -> FloatImage:
    """The least of each band."""
    return _where_known(looks_of(stack), np.fmin.reduce(stack.values, axis=0, initial=np.nan))


def brightest(stack: LookStack) -> FloatImage:
    """The most of each band."""
    return _where_known(looks_of(stack), np.fmax.reduce(stack.values, axis=0, initial=np.nan))


def deviation(stack: LookStack) -> FloatImage:
    """Standard deviation over the looks."""
    count = looks_of(stack)
    middle, total = _mean(stack, count), np.zeros(stack.values.shape[1:], np.float32)
    for one in stack.values:  # several times as fast as nansum
        apart = one - middle
        cv2.patchNaNs(apart, 0.0)
        total += apart * apart
    return _where_known(count, np.sqrt(total / np.maximum(count - 1, 1)[..., None]))


FORMS: Mapping[str, Callable[[LookStack], FloatImage]] = {
    "mean": mean,
    "median": median,
    "min": darkest,
    "max": brightest,
    "deviation": deviation,
}


def _mean(stack: LookStack, count: Matrix) -> FloatImage:
    total = np.zeros(stack.values.shape[1:], np.float32)
    for one in stack.values:  # several times as fast as nansum
        known = one.copy()
        cv2.patchNaNs(known, 0.0)
        total += known
    return np.asarray(total / np.maximum(count, 1)[..., None], np.float32)


def _where_known(count: Matrix, values: FloatImage) -> FloatImage:
    if count.min(initial=LEAST_LOOKS) >= LEAST_LOOKS:
        return np.asarray(values, np.float32)
    return np.where(count[..., None] >= LEAST_LOOKS, values, np.nan).astype(np.float32)
