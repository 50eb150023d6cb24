"""How long files usually take, read from the two rows of times alone, so that no wrong match can mislead it.

Every difference between a late file and an earlier shot is tried; the one under which the most files fall on shots,
and the fewest shots are left without a file, is the delay. Shots are seldom quite regular, so it stands out.
"""

from __future__ import annotations

from bisect import bisect, insort
from collections import deque
from itertools import pairwise
from statistics import median

_FILES, _SHOTS = 32, 80
_TRIED = 4  # newest files whose distances to the shots are tried
_SHARP_S = 1.0  # a file that is further off a shot than this counts for nothing
_BETTER = 4.0  # by so many files another delay must explain more: chance alone reaches 3
_FOLLOW = 0.2  # share of the newest files' median distance by which a delay that grows is followed


class UsualDelay:
    """Seconds from a shot to its file; `value` is None until a few files have come."""

    def __init__(self, early_s: float, window_s: float, widest_s: float) -> None:
        self.value: float | None = None
        self.tolerance_s = widest_s
        """Further than this from the usual delay, a file is nearer to another shot."""
        self._early_s, self._window_s, self._widest_s = early_s, window_s, widest_s
        self._shots: list[float] = []
        self._files: deque[float] = deque(maxlen=_FILES)

    def shot(self, moment: float) -> None:
        """A picture was taken."""
        insort(self._shots, moment)
        if len(self._shots) > _SHOTS:
            self._shots.pop(0)

    def file(self, received: float) -> None:
        """A file has come: think again."""
        self._files.append(received)
        candidates = self._candidates()
        if self.value is None:
            # The oldest shot in reach: rather a slow link than a lost first picture.
            self.value = max(candidates, default=None)
            return
        best = max(candidates, key=self._score, default=self.value)
        if self._score(best) > self._score(self.value) + _BETTER:
            self.value = best
        elif self._shots:
            self.value += _FOLLOW * self._median_distance(self.value)
        gaps = [later - earlier for earlier, later in pairwise(self._shots)]
        self.tolerance_s = min(self._widest_s, median(gaps) / 2) if gaps else self._widest_s

    def _candidates(self) -> list[float]:
        delays = [file - shot for file in list(self._files)[-_TRIED:] for shot in self._shots]
        return [delay for delay in delays if -self._early_s <= delay <= self._window_s]

    def _score(self, delay: float) -> float:
        files = sorted(file - delay for file in self._files)
        explained = sum(max(0.0, 1 - abs(_distance(file, self._shots)) / _SHARP_S) for file in files)
        began = files[0] - _SHARP_S if len(files) == _FILES else self._shots[0]
        due = self._shots[bisect(self._shots, began - 1e-9) : bisect(self._shots, files[-1])]
        return explained - sum(abs(_distance(shot, files)) > _SHARP_S for shot in due)

    def _median_distance(self, delay: float) -> float:
        return median(_distance(file - delay, self._shots) for file in self._files)


def _distance(time: float, row: list[float]) -> float:
    """From the nearest in a sorted row to `time`; positive if `time` is later."""
    place = bisect(row, time)
    return min((time - near for near in row[max(place - 1, 0) : place + 1]), key=abs)
