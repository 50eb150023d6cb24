"""Estimates the usual delay from shot to file from the two series of times alone, so that no wrong match can bias it.

Every difference between a recent file and an earlier shot is a candidate; the delay is the one under which most files
coincide with shots and fewest shots lack a file. Shots are rarely quite regular, so it stands out.
"""

from __future__ import annotations

from bisect import bisect, insort
from collections import deque
from itertools import pairwise
from statistics import median

MOST_FILES, MOST_SHOTS = 32, 80  # newest ones that are kept
_TRIED = 4  # newest files that supply candidates
_SHARP_S = 1.0  # a file further than this from a shot scores nothing
_AT_ONCE_S = 0.05  # shots so close are of several cameras that are triggered together: no burst is faster
_BETTER = 4.0  # files by which another delay must score higher: chance alone reaches 3
_FOLLOW = 0.2  # share of the files' median distance by which the delay is tracked


class UsualDelay:
    """Seconds from a shot to its file; `value` is None until a file arrives in reach of a shot."""

    def __init__(self, early_s: float, window_s: float, widest_s: float) -> None:
        self.value: float | None = None
        self.tolerance_s = widest_s
        """Deviation from the usual delay beyond which a file is nearer to another shot."""
        self._early_s, self._window_s, self._widest_s = early_s, window_s, widest_s
        self._shots: list[float] = []
        self._files: deque[float] = deque(maxlen=MOST_FILES)

    def shot(self, moment: float) -> None:
        """A picture was taken."""
        insort(self._shots, moment)
        if len(self._shots) > MOST_SHOTS:
            self._shots.pop(0)

    def file(self, received: float) -> None:
        """A file has arrived: update the estimate."""
        self._files.append(received)
        candidates = self._candidates()
        if self.value is None:
            # The oldest shot in reach: a slow link is likelier than a lost first picture.
            self.value = max(candidates, default=None)
            return
        best = max(candidates, key=self._score, default=self.value)
        if self._score(best) > self._score(self.value) + _BETTER:
            self.value = best
        elif self._shots:
            self.value += _FOLLOW * self._median_distance(self.value)
        self.tolerance_s = min(self._widest_s, self.usual_gap_s / 2 or self._widest_s)

    @property
    def shots(self) -> int:
        """How many are kept."""
        return len(self._shots)

    @property
    def usual_gap_s(self) -> float:
        """Between two shots; those that several cameras take at once are of one time."""
        gaps = [gap for earlier, later in pairwise(self._shots) if (gap := later - earlier) > _AT_ONCE_S]
        return median(gaps) if gaps else 0.0

    def agreement(self) -> float:
        """How many of the last files the shots explain, less the shots beyond one for each file, or without one."""
        if self.value is None or not self._files or not self._shots:
            return 0.0
        files = sorted(file - self.value for file in self._files)
        began = files[0] - _SHARP_S if len(files) == MOST_FILES else self._shots[0]
        due = bisect(self._shots, files[-1] + _SHARP_S) - bisect(self._shots, began - 1e-9)
        explained = sum(max(0.0, 1 - abs(_distance(file, self._shots)) / _SHARP_S) for file in files)
        return min(self._score(self.value), explained - max(0, due - len(files)))

    def _candidates(self) -> list[float]:
        delays = [file - shot for file in list(self._files)[-_TRIED:] for shot in self._shots]
        return [delay for delay in delays if -self._early_s <= delay <= self._window_s]

    def _score(self, delay: float) -> float:
        files = sorted(file - delay for file in self._files)
        explained = sum(max(0.0, 1 - abs(_distance(file, self._shots)) / _SHARP_S) for file in files)
        began = files[0] - _SHARP_S if len(files) == MOST_FILES else self._shots[0]
        due = self._shots[bisect(self._shots, began - 1e-9) : bisect(self._shots, files[-1])]
        return explained - sum(abs(_distance(shot, files)) > _SHARP_S for shot in due)

    def _median_distance(self, delay: float) -> float:
        return median(_distance(file - delay, self._shots) for file in self._files)


def _distance(time: float, row: list[float]) -> float:
    """Signed distance from the nearest of a sorted list to `time`; positive if `time` is later."""
    place = bisect(row, time)
    return min((time - near for near in row[max(place - 1, 0) : place + 1]), key=abs)
