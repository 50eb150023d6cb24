"""The legend that a thermal camera burns into its pictures: a bar of its palette's colours, at one place of all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR

SHORTEST, MOST_SLENDER = (
    0.25,
    0.12,
)  # length of a bar as a share of the picture's side along it, and width of the side across
THINNEST = 4  # px
ALIKE = 14.0  # grey levels, RMS of the colours across a bar about their mean: compression leaves a few
SMOOTH = 30.0  # grey levels from row to row
COLOURFUL = 120.0  # grey levels that the bar's colours go through along it, at least
STILL = 20.0  # grey levels by which a row differs from the mean of all pictures
PARTS = 24  # colours that are told


def legend_in(pictures: Sequence[ImageBGR]) -> list[tuple[int, int, int]]:
    """Blue, green and red of the burnt-in bar at `PARTS` even steps from its foot to its head, a lying one from left to right;
    empty if not at least two pictures (h, w, 3) of one size have the same bar at the same place."""
    if len(pictures) < 2 or len({one.shape for one in pictures}) > 1:
        return []
    found = [colours for one in (False, True) if (colours := _standing(pictures, lying=one)) is not None]
    if not found:
        return []
    longest = max(found, key=len)
    steps = np.linspace(0, len(longest) - 1, PARTS)
    told = np.stack([np.interp(steps, np.arange(len(longest)), longest[:, band]) for band in range(3)], axis=-1)
    return [(blue, green, red) for blue, green, red in np.rint(told).astype(int).tolist()]


def _standing(pictures: Sequence[ImageBGR], *, lying: bool) -> FloatImage | None:
    """The colours (n, 3) of the longest standing bar, from its foot to its head; None if there is none."""
    # A lying bar, turned, has its right end on top.
    turned = [np.rot90(one).astype(np.float32) if lying else one.astype(np.float32) for one in pictures]
    found = [_bar([one[box] for one in turned], turned[0].shape[0]) for box in _still_boxes(turned)]
    return max((one for one in found if one is not None), key=len, default=None)


def _still_boxes(pictures: Sequence[FloatImage]) -> Iterator[tuple[slice, slice]]:
    """Slender upright boxes (rows, columns) that are alike in all pictures."""
    height, width = pictures[0].shape[:2]
    still = (np.ptp(pictures, axis=0).max(axis=2) < 2 * STILL).astype(np.uint8)
    tall = np.ones((max(3, round(SHORTEST * height / 4)), THINNEST), np.uint8)
    count, _, boxes, _ = cv2.connectedComponentsWithStats(
        np.asarray(cv2.morphologyEx(still, cv2.MORPH_OPEN, tall), np.uint8)
    )
    for left, top, wide, high, _ in boxes[1:count].tolist():
        if wide <= MOST_SLENDER * width:
            rim = wide // 4  # of other colours
            yield slice(top, top + high), slice(left + rim, left + wide - rim)


def _bar(boxes: Sequence[FloatImage], height: int) -> FloatImage | None:
    """The rows (n, 3) of boxes (n, w, 3) of several pictures that are one bar of many colours; None if they are none."""
    along = [box.mean(axis=1) for box in boxes]
    mean = np.asarray(np.mean(along, axis=0), np.float32)
    is_even = [
        np.sqrt(((box - line[:, None]) ** 2).mean(axis=(1, 2))) < ALIKE for box, line in zip(boxes, along, strict=True)
    ]
    is_still = [np.abs(line - mean).max(axis=1) < STILL for line in along]
    steps = np.abs(np.diff(mean, axis=0, prepend=mean[:1])).max(axis=1)
    first, last = _longest_run(np.all([*is_even, *is_still, steps < SMOOTH], axis=0))
    bar = mean[first:last]
    if len(bar) < SHORTEST * height:
        return None
    return np.asarray(bar[::-1], np.float32) if float(np.ptp(bar, axis=0).max()) > COLOURFUL else None


def _longest_run(there: NDArray[np.bool_]) -> tuple[int, int]:
    """Begin and end of the longest run of ones."""
    edges = np.flatnonzero(np.diff(np.r_[False, there, False]))
    if not len(edges):
        return 0, 0
    begins, ends = edges[::2], edges[1::2]
    longest = int((ends - begins).argmax())
    return int(begins[longest]), int(ends[longest])
