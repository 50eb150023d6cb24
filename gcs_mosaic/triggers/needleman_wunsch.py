"""The best alignment of two rows in order, from each of which some may be lost (Needleman and Wunsch 1970). Pure."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int64]

LOST = -3.2  # a shot without file, or a file without shot
LOST_AT_END = -2.6  # before the flight and after it there are more of them


def needleman_wunsch(scores: Floats) -> tuple[float, Places]:
    """The best alignment of shots and files, in order: its score, and each shot's file (-1: none)."""
    shots, files = scores.shape
    along = np.full(files + 1, LOST)  # what it costs to pass over a file, after k shots
    steps = np.zeros((shots + 1, files + 1), np.int8)  # 0: pair, 1: shot without file, 2: file without shot
    best = np.arange(files + 1) * LOST_AT_END
    steps[0, 1:] = 2
    for shot in range(1, shots + 1):
        lost = np.full(files + 1, LOST)
        lost[[0, files]] = LOST_AT_END
        row = best + lost
        paired = best[:-1] + scores[shot - 1]
        steps[shot] = 1
        steps[shot, 1:][paired >= row[1:]] = 0
        row[1:] = np.maximum(row[1:], paired)
        cost = (LOST_AT_END if shot == shots else along[0]) * np.arange(files + 1)
        passed = np.maximum.accumulate(row - cost) + cost
        steps[shot][passed > row + 1e-9] = 2
        best = passed
    return float(best[-1]), _traced(steps)


def _traced(steps: NDArray[np.int8]) -> Places:
    shot, file = steps.shape[0] - 1, steps.shape[1] - 1
    file_of = np.full(shot, -1)
    while shot or file:
        step = steps[shot, file] if shot and file else 1 if shot else 2
        shot, file = shot - (step != 2), file - (step != 1)
        if step == 0:
            file_of[shot] = file
    return file_of
