"""The likeliest way in which a stretch of shots and files belong together, and whether another one is about as good. Pure.

Shots and files are two rows in order, from each of which some are lost. What speaks for a pair is measured with rulers: a
number in the names that goes with a counter, the camera's clock and the files' arrivals against the times of the shots. A
ruler's zero (how far numbers, clocks and delays are apart) is not known, so every shift of the rows gives one, the rows are
aligned by it (Needleman and Wunsch 1970), and the likelihoods of the results are compared. A ruler that most pairs do not
agree with is no ruler. All likelihoods are natural logarithms against chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.triggers.names import Field

Floats: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int64]
Key = TypeVar("Key", bound=Hashable)

NUMBERS, CLOCK, ARRIVAL = "the numbers in the file names", "the camera's clock", "the files' arrival"
MOST = 800  # shots and files of a stretch: the matrices are quadratic
SURE = 5.0  # an explanation less likely by a factor of e^5 is none
_SURE_BY_ORDER = 8.0  # ... of e^8, where no time tells how far the rows are shifted and some of them are lost
_SHIFTS = 6  # tried either way, beyond those that the lengths of the rows differ by
_REFINED = 6  # best shifts that are aligned again by the zeros found
_LOST = -3.2  # a shot without file, or a file without shot
_LOST_AT_END = -2.6  # before the flight and after it there are more of them
_AGREES, _DIFFERS = 2.2, -6.0  # of numbers
_OUTLIER = 0.001  # share of times that are wrong
_PEAKS = 10  # zeros of one ruler that are tried
_CHANCE_S = 30.0  # times that agree by chance lie anywhere in such a range
_LEAST, _HALF = 3, 0.6  # pairs that a ruler must explain, and their share
_ZONE_S, _SET_S = 900.0, 1.0  # time zones differ by quarters of an hour; a clock that is set is this exact
_IS_SET = 0.5  # share of clocks that are set
_SAME_COUNT = 0.5  # in favour of a number that is the counter's own
_EARLIEST_S, _LATEST_S = -1.5, 15.0  # a file's arrival after its shot
_IMPOSSIBLE_S, _NEVER = -10.0, -100.0  # a file that came so long before its shot is another one's
_STRANGERS = -2.0  # a pair less likely than chance by more is left out
_MORE = 2 * -_LOST + _AGREES + 3.2  # what one more pair brings: nothing is lost, number and time agree
_BY_CHANCE = 2.0  # times the root of what is lost: pairs by which a wrong shift may be ahead
_KEPT_APART = 1.0  # by which pairs of the best alignment are made worse, to find the next best


@dataclass(frozen=True, slots=True)
class ShotClue:
    """What is known of a shot: when it was, and its number in each counter."""

    moment: float
    counts: Mapping[Hashable, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FileClue:
    """What is known of a file: the numbers in its name, its time by the camera's clock, and when it came; None: not known."""

    numbers: Mapping[Field, int]
    captured: float | None = None
    arrived: float | None = None


@dataclass(frozen=True, slots=True)
class Alignment:
    """`pairs`: places of a shot and its file, in order. `shifts`: by how many shots later (or earlier) each file may as well
    belong; `unsure`: how many pairs that concerns. `told_by`: the rulers, for display."""

    pairs: list[tuple[int, int]]
    shifts: tuple[int, ...]
    unsure: int
    told_by: tuple[str, ...]
    score: float
    better_by: float | None = None  # than the pairs so far


@dataclass(frozen=True, slots=True)
class _Explained:
    score: float
    file_of: Places  # for each shot, -1: none
    told_by: tuple[str, ...]


def align(
    shots: Sequence[ShotClue],
    files: Sequence[FileClue],
    utc_of_zero: float | None = None,
    pairs_so_far: Sequence[tuple[int, int]] | None = None,
) -> Alignment:
    """Align two rows, each in the order of capture; at most `MOST` of each. `utc_of_zero`: UTC at the zero of the moments.

    `pairs_so_far`: what it is compared with.
    """
    rows = _Rows(shots, files, utc_of_zero)
    if not shots or not files:
        return Alignment([], (), 0, (), 0.0)
    known = None if pairs_so_far is None else _file_of(pairs_so_far, len(shots))
    explained = rows.refined([*rows.guesses(), *([] if known is None else [known])])
    best = explained[0]
    others = [*explained, rows.next_best(best)]
    better_by = None if known is None else rows.better_by(best, known)
    pairs = [(shot, int(file)) for shot, file in enumerate(best.file_of) if file >= 0]
    is_whole = len(pairs) == len(shots) == len(files)
    margin = SURE if is_whole or {CLOCK, ARRIVAL} & {*best.told_by} else _SURE_BY_ORDER
    rivals = [one for one in others if best.score - one.score < margin and _apart(best, one) > 0]
    base = best
    if known is not None and better_by is not None and (known >= 0).any():
        base = _Explained(0.0, known, ())  # what there is, and stays where anything is as good
        rivals += [base] if better_by < margin else []
    shifts = {shift for one in [best, *rivals] if (shift := _shift(base, one))}
    unsure = max((_apart(best, one) for one in rivals), default=0)
    if not best.told_by and not is_whole:
        unsure = len(pairs)  # some are lost, and nothing tells which
    likely = rows.likely(best)
    return Alignment(
        [pair for pair in pairs if pair[0] in likely],
        tuple(sorted(shifts)),
        unsure,
        best.told_by,
        best.score,
        better_by,
    )


def _shifts(shots: int, files: int) -> list[int]:
    """Shots by which the first file may lie off, the smallest first."""
    beyond, most = shots - files, min(_SHIFTS, max(min(shots, files) - 2, 0))
    return sorted(range(min(beyond, 0) - most, max(beyond, 0) + most + 1), key=abs)


def _peaks(apart: Floats, within: float) -> list[float]:
    """The differences (shots x files) that come most often, at most `_PEAKS`; those of one peak once."""
    known = np.sort(apart[~np.isnan(apart)])
    if not len(known):
        return []
    counts = np.searchsorted(known, known + 2 * within, "right") - np.arange(len(known))
    found = list[float]()
    for at in np.argsort(-counts, kind="stable"):
        middle = float(known[at : at + counts[at]].mean())
        if all(abs(middle - one) > within for one in found):
            found.append(middle)
        if len(found) == _PEAKS:
            break
    return found


def _file_of(pairs: Sequence[tuple[int, int]], shots: int) -> Places:
    file_of = np.full(shots, -1)
    for shot, file in pairs:
        file_of[shot] = file
    return file_of


def _shifted(shift: int, shots: int, files: int) -> Places:
    """File k belongs to shot k + `shift`."""
    file_of = np.arange(shots) - shift
    return np.where((file_of >= 0) & (file_of < files), file_of, -1)


def _lucky(best: Places, other: Places, files: int) -> float:
    """What the best may owe to chance: where shots and files are lost independently, as many meet by any shift of the rows,
    give or take a few; only that many of its additional pairs are discounted."""
    more = int((best >= 0).sum() - (other >= 0).sum())
    lost = len(best) + files - 2 * int((best >= 0).sum())
    return _MORE * min(max(more, 0), _BY_CHANCE * float(np.sqrt(lost)))


def _apart(best: _Explained, other: _Explained) -> int:
    """How many files of the best explanation belong to another shot by the other one."""
    both = (best.file_of >= 0) & (other.file_of >= 0)
    return int((best.file_of != other.file_of)[both].sum())


def _shift(best: _Explained, other: _Explained) -> int:
    """By how many shots most of those are later."""
    shot_of = {int(file): shot for shot, file in enumerate(best.file_of) if file >= 0}
    moved = Counter(
        shot - shot_of[int(file)]
        for shot, file in enumerate(other.file_of)
        if file >= 0 and int(file) in shot_of and shot_of[int(file)] != shot
    )
    return moved.most_common(1)[0][0] if moved else 0


@dataclass(frozen=True, slots=True)
class _Zeros:
    """By how much each ruler's two scales differ: place among the rulers and difference; seconds and their scatter. None where
    the pairs do not agree with it."""

    numbers: tuple[int, float] | None
    clock: tuple[float, float] | None
    arrival: tuple[float, float] | None

    @property
    def told_by(self) -> tuple[str, ...]:
        rulers = {NUMBERS: self.numbers, CLOCK: self.clock, ARRIVAL: self.arrival}
        return tuple(name for name, zero in rulers.items() if zero is not None)


class _Rows:
    """Both rows as arrays, and what speaks for pairs of them."""

    def __init__(self, shots: Sequence[ShotClue], files: Sequence[FileClue], utc_of_zero: float | None) -> None:
        self._moments = np.array([one.moment for one in shots])
        self._captured = _times(one.captured for one in files)
        self._arrived = _times(one.arrived for one in files)
        counts, numbers = [one.counts for one in shots], [one.numbers for one in files]
        self._counts = [_times(one.get(key) for one in counts) for key in _keys(counts)]
        self._numbers = [_times(one.get(key) for one in numbers) for key in _keys(numbers)]
        self._utc_of_zero = utc_of_zero
        self._explained: dict[_Zeros, _Explained] = {}

    def guesses(self) -> Iterator[Places]:
        """First guesses of each shot's file: by shifts of the rows, and by what times and numbers differ by most often."""
        shots, files = len(self._moments), len(self._captured)
        for shift in _shifts(shots, files):
            yield _shifted(shift, shots, files)
        apart = [(self._clock_apart(), 0.7), (self._arrival_apart(), 0.7)]
        apart += [(numbers[None, :] - counts[:, None], 0.1) for counts, numbers in self._rulers()]
        for differences, within in apart:
            for zero in _peaks(differences, within):
                yield _nearest(np.abs(differences - zero), within)

    def explain(self, file_of: Places) -> _Explained:
        """Align by the zeros that a first guess of the pairs gives."""
        zeros = self._zeros(file_of)
        if zeros not in self._explained:
            total, aligned = _needleman_wunsch(self._scores(zeros))
            self._explained[zeros] = _Explained(total + self._prior(zeros), aligned, zeros.told_by)
        return self._explained[zeros]

    def refined(self, guesses: Sequence[Places]) -> list[_Explained]:
        """Explanations by these first guesses, and by what the best of them give, the likeliest first."""
        explained = [self.explain(guess) for guess in guesses]
        explained.sort(key=lambda one: -one.score)  # stable: of equals the smallest shift
        for _ in range(2):
            explained += [self.explain(one.file_of) for one in explained[:_REFINED]]
            explained.sort(key=lambda one: -one.score)
        return explained

    def likely(self, best: _Explained) -> frozenset[int]:
        """The shots whose pairs are no worse than chance: between two losses strangers may have been left beside each other."""
        scores, shots = self._scores(self._zeros(best.file_of)), np.flatnonzero(best.file_of >= 0)
        return frozenset(shots[scores[shots, best.file_of[shots]] > _STRANGERS].tolist())

    def score_of(self, file_of: Places) -> float:
        """How likely these pairs are, in whatever order; what is lost at an end costs as in the middle of a row, or less."""
        zeros = self._zeros(file_of)
        scores, prior = self._scores(zeros), self._prior(zeros)
        shots = np.flatnonzero(file_of >= 0)
        files = file_of[shots]
        lost = len(self._moments) + len(self._captured) - 2 * len(shots)
        at_ends = 0
        if len(shots):
            at_ends = int(
                shots[0] + len(self._moments) - 1 - shots[-1] + files.min() + len(self._captured) - 1 - files.max()
            )
        return float(scores[shots, files].sum() + prior + _LOST * (lost - at_ends) + _LOST_AT_END * at_ends)

    def better_by(self, best: _Explained, known: Places) -> float:
        """By how much the best is likelier than the known pairs, and than these where a few of them are mended by the rest."""
        mended = self.explain(known)
        better = best.score - self.score_of(known) - _lucky(best.file_of, known, len(self._captured))
        if _apart(best, mended) == 0:
            return better
        return min(better, best.score - mended.score - _lucky(best.file_of, mended.file_of, len(self._captured)))

    def next_best(self, best: _Explained) -> _Explained:
        """The same zeros, but with as few of these pairs as that is worth it."""
        zeros = self._zeros(best.file_of)
        shots = np.flatnonzero(best.file_of >= 0)
        apart = self._scores(zeros)
        apart[shots, best.file_of[shots]] -= _KEPT_APART
        total, aligned = _needleman_wunsch(apart)
        kept = int(((aligned == best.file_of) & (aligned >= 0)).sum())
        return _Explained(total + _KEPT_APART * kept + self._prior(zeros), aligned, zeros.told_by)

    def _zeros(self, file_of: Places) -> _Zeros:
        """The zeros of all rulers that these pairs agree with."""
        shots = np.flatnonzero(file_of >= 0)
        files = file_of[shots]
        return _Zeros(
            self._zero_of_numbers(shots, files),
            _zero_of(self._captured[files] - self._moments[shots], sharp_s=0.3),
            _zero_of(self._arrived[files] - self._moments[shots], sharp_s=0.5),
        )

    def _zero_of_numbers(self, shots: Places, files: Places) -> tuple[int, float] | None:
        """The counter and number in the names that agree best, and by how much they differ."""
        found, agreeing = None, _LEAST - 1
        for place, (counts, numbers) in enumerate(self._rulers()):
            differ = numbers[files] - counts[shots]
            known = differ[~np.isnan(differ)]
            if len(known) < _LEAST:
                continue
            values, times = np.unique(known, return_counts=True)
            zero, most = values[times.argmax()], int(times.max())
            if most > agreeing and most >= _HALF * len(known):
                found, agreeing = (place, float(zero)), most
        return found

    def _scores(self, zeros: _Zeros) -> Floats:
        """What speaks for each pair (shots x files), by all rulers."""
        scores = np.zeros((len(self._moments), len(self._captured)))
        if zeros.numbers is not None:
            counts, numbers = list(self._rulers())[zeros.numbers[0]]
            apart = numbers[None, :] - counts[:, None] - zeros.numbers[1]
            scores += np.where(np.isnan(apart), 0.0, np.where(apart == 0, _AGREES, _DIFFERS))
        if zeros.clock is not None:
            scores += _fitting(self._clock_apart(), *zeros.clock)
        if zeros.arrival is not None:
            scores += _fitting(self._arrival_apart(), *zeros.arrival)
        scores[self._arrival_apart() < _IMPOSSIBLE_S] = _NEVER
        return scores

    def _prior(self, zeros: _Zeros) -> float:
        """How likely such zeros are: delays are short, and a clock that is set is exact but for the time zone."""
        prior = _SAME_COUNT if zeros.numbers is not None and zeros.numbers[1] == 0 else 0.0
        if zeros.clock is not None and self._utc_of_zero is not None:
            off = (zeros.clock[0] - self._utc_of_zero + _ZONE_S / 2) % _ZONE_S - _ZONE_S / 2
            density = _IS_SET * np.exp(-0.5 * (off / _SET_S) ** 2) / (_SET_S * np.sqrt(2 * np.pi))
            prior += float(np.log(density * _ZONE_S + 1 - _IS_SET))
        if zeros.arrival is not None:
            delay = zeros.arrival[0]
            too_early, too_late = max(0.0, _EARLIEST_S - delay), max(0.0, delay - _LATEST_S)
            prior -= 2.0 * max(0.0, -delay) + 4.0 * too_early + 0.3 * too_late
        return prior

    def _rulers(self) -> Iterator[tuple[Floats, Floats]]:
        """Counters of the shots and numbers in the names that both vary."""
        for counts in filter(_varies, self._counts):
            for numbers in filter(_varies, self._numbers):
                yield counts, numbers

    def _clock_apart(self) -> Floats:
        apart: Floats = self._captured[None, :] - self._moments[:, None]
        return apart

    def _arrival_apart(self) -> Floats:
        apart: Floats = self._arrived[None, :] - self._moments[:, None]
        return apart


def _zero_of(apart: Floats, sharp_s: float) -> tuple[float, float] | None:
    """The usual difference of the pairs in seconds, and how far they scatter; None if they do not agree."""
    known = apart[~np.isnan(apart)]
    if len(known) < _LEAST:
        return None
    zero = _mode(known)
    off = np.abs(known - zero)
    near = off[off < 3.0]
    if len(near) < _HALF * len(known):
        return None
    sigma = max(sharp_s, 1.4826 * float(np.median(near)))
    # Of pairs that agree no better than chance, the clock is none.
    gain = np.log(_density(off, sigma)).sum()
    return (round(zero, 2), round(sigma, 2)) if gain > 0 else None


def _fitting(apart: Floats, zero: float, sigma: float) -> Floats:
    """What differences in seconds say; nothing where one time is not known."""
    return np.nan_to_num(np.log(_density(apart - zero, sigma)), nan=0.0)


def _density(off: Floats, sigma: float) -> Floats:
    """Likelihood of a deviation in seconds against chance."""
    fits = np.exp(-0.5 * (off / sigma) ** 2) * (_CHANCE_S / (sigma * np.sqrt(2 * np.pi)))
    density: Floats = (1 - _OUTLIER) * fits + _OUTLIER
    return density


def _nearest(off: Floats, within: float) -> Places:
    """For each shot the file of the least difference (shots x files) from what is expected; -1 if none is as near as that."""
    off = np.where(np.isnan(off), np.inf, off)
    nearest = off.argmin(axis=1)
    return np.where(off[np.arange(len(off)), nearest] <= within, nearest, -1)


def _varies(values: Floats) -> bool:
    """Whether most of them differ: a counter of shots is no width, no date, and none that stays the same."""
    known = values[~np.isnan(values)]
    return len(known) >= _LEAST and len(np.unique(known)) >= max(_LEAST, len(known) / 2)


def _mode(values: Floats) -> float:
    """The middle of the densest half."""
    ordered = np.sort(values)
    half = (len(ordered) + 1) // 2
    widths = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
    start = int(widths.argmin())
    return float(np.median(ordered[start : start + half]))


def _needleman_wunsch(scores: Floats) -> tuple[float, Places]:
    """The best alignment of shots and files, in order: its score, and each shot's file (-1: none)."""
    shots, files = scores.shape
    along = np.full(files + 1, _LOST)  # what it costs to pass over a file, after k shots
    steps = np.zeros((shots + 1, files + 1), np.int8)  # 0: pair, 1: shot without file, 2: file without shot
    best = np.arange(files + 1) * _LOST_AT_END
    steps[0, 1:] = 2
    for shot in range(1, shots + 1):
        lost = np.full(files + 1, _LOST)
        lost[[0, files]] = _LOST_AT_END
        row = best + lost
        paired = best[:-1] + scores[shot - 1]
        steps[shot] = 1
        steps[shot, 1:][paired >= row[1:]] = 0
        row[1:] = np.maximum(row[1:], paired)
        cost = (_LOST_AT_END if shot == shots else along[0]) * np.arange(files + 1)
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


def _keys(rows: Sequence[Mapping[Key, int]]) -> list[Key]:
    """The keys that most have, at most a dozen: names are anybody's."""
    counted = Counter(key for row in rows for key in row)
    return [key for key, _ in counted.most_common(12)]


def _times(values: Iterator[float | int | None]) -> Floats:
    return np.array([np.nan if value is None else float(value) for value in values])
