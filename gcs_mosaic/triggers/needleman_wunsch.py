"""The best alignment of two rows in order, from each of which some may be lost (Needleman and Wunsch 1970). Pure.

Of long rows only a band of pairs is looked at: for each shot, the files near the one that is expected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int64]

LOST = -3.2  # a shot without file, or a file without shot
LOST_AT_END = -2.6  # before the flight and after it there are more of them


@dataclass(frozen=True, slots=True)
class Band:
    """The pairs that are looked at: shot k with `width` files from `first[k]` on, which never goes back; of `files` files."""

    first: Places
    width: int
    files: int

    @property
    def places(self) -> tuple[Places, Places]:
        """Places of shots and files, which together give shots x `width`."""
        return np.arange(len(self.first))[:, None], self.first[:, None] + np.arange(self.width)[None, :]


def whole(shots: int, files: int) -> Band:
    """All pairs."""
    return Band(np.zeros(shots, np.int64), files, files)


def needleman_wunsch(scores: Floats, band: Band) -> tuple[float, Places]:
    """The best alignment of shots and files, in order: its score, and each shot's file (-1: none). `scores`: of the band."""
    shots, width = scores.shape
    begins = np.concatenate([band.first[:1], band.first])  # after k shots, so many files are passed over at least
    steps = np.full((shots + 1, width + 1), 2, np.int8)  # 0: pair, 1: shot without file, 2: file without shot
    best = (begins[0] + np.arange(width + 1)) * LOST_AT_END
    for shot in range(1, shots + 1):
        best = _moved(best, int(begins[shot] - begins[shot - 1]), LOST if shot > 1 else LOST_AT_END)
        passed_over = begins[shot] + np.arange(width + 1)
        row = best + np.where((passed_over == 0) | (passed_over == band.files), LOST_AT_END, LOST)
        paired = best[:-1] + scores[shot - 1]
        steps[shot] = 1
        steps[shot, 1:][paired >= row[1:]] = 0
        row[1:] = np.maximum(row[1:], paired)
        cost = (LOST_AT_END if shot == shots else LOST) * np.arange(width + 1)
        passed = np.maximum.accumulate(row - cost) + cost
        steps[shot][passed > row + 1e-9] = 2
        best = passed
    after = band.files - int(begins[-1]) - width
    return float(best[-1]) + LOST_AT_END * after, _traced(steps, begins, band.files)


def _moved(best: Floats, by: int, lost: float) -> Floats:
    """The best so far where the band moves on by so many files; it leaves those out that lie before the next."""
    return np.concatenate([best, best[-1] + lost * np.arange(1, by + 1)])[by:] if by else best


def _traced(steps: NDArray[np.int8], begins: Places, files: int) -> Places:
    shot, file, width = steps.shape[0] - 1, files, steps.shape[1] - 1
    file_of = np.full(shot, -1)
    while shot or file:
        place = file - int(begins[shot])
        step = 1 if not file else 2 if not shot or place > width else steps[shot, place]
        shot, file = shot - (step != 2), file - (step != 1)
        if step == 0:
            file_of[shot] = file
    return file_of
