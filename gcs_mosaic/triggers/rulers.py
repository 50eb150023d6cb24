"""Rulers: what speaks for a shot and a file to belong together. Pure.

A number in the names that goes with a counter, the camera's clock and the files' arrivals against the times of the shots. A
ruler's zero (how far numbers, clocks and delays are apart) is found from pairs. A ruler that most pairs do not agree with is no
ruler. All likelihoods are natural logarithms against chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from gcs_mosaic.triggers.names import Field
from gcs_mosaic.triggers.needleman_wunsch import LOST, Floats, Places

Key = TypeVar("Key", bound=Hashable)

NUMBERS, CLOCK, ARRIVAL = "the numbers in the file names", "the camera's clock", "the files' arrival"
AGREES, _DIFFERS = 2.2, -6.0  # of numbers
_OUTLIER = 0.001  # share of times that are wrong
_LATE = 0.02  # ... of files that come later than usual, however much: a link that was gone holds them back
_PEAKS = 10  # zeros of one ruler that are tried
_COMPARED = 2_500_000  # differences that are looked through for them: all of 1,500 shots and files, a share of more
_AT_ENDS = 4  # shots and files at either end by which they are shifted
_WITHIN_S, _WITHIN = 0.7, 0.1  # times and numbers that agree
_CHANCE_S = 30.0  # times that agree by chance lie anywhere in such a range
_NEAR_S = 3.0  # seconds from the usual difference within which others count towards their scatter
_LEAST, _HALF = 3, 0.6  # pairs that a ruler must explain, and their share
_ZONE_S, _SET_S = 900.0, 1.0  # time zones differ by quarters of an hour; a clock that is set is this exact
_IS_SET = 0.5  # share of clocks that are set
_SAME_COUNT = 0.5  # in favour of a number that is the counter's own
_MEETING = AGREES - 2 * LOST  # what an alignment gains where a number that is lacking meets one that is
_SPARSE = 10  # times as many numbers as there are shots and files: they have begun anew
_EARLIEST_S, _LATEST_S = -1.5, 15.0  # a file's arrival after its shot
_IMPOSSIBLE_S, _NEVER = -10.0, -100.0  # a file that came so long before its shot is another one's


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
class Zeros:
    """By how much each ruler's two scales differ: place among the rulers and difference; seconds and their scatter. None where
    the pairs do not agree with it."""

    numbers: tuple[int, float] | None
    clock: tuple[float, float] | None
    arrival: tuple[float, float] | None

    @property
    def told_by(self) -> tuple[str, ...]:
        rulers = {NUMBERS: self.numbers, CLOCK: self.clock, ARRIVAL: self.arrival}
        return tuple(name for name, zero in rulers.items() if zero is not None)


class Rulers:
    """Of some shots and files."""

    def __init__(self, shots: Sequence[ShotClue], files: Sequence[FileClue], utc_of_zero: float | None) -> None:
        self.shots, self.files = len(shots), len(files)
        self._moments = np.array([one.moment for one in shots])
        self._captured = _times(one.captured for one in files)
        self._arrived = _times(one.arrived for one in files)
        counts, numbers = [one.counts for one in shots], [one.numbers for one in files]
        self._counts = [_times(one.get(key) for one in counts) for key in _keys(counts)]
        self._numbers = [_times(one.get(key) for one in numbers) for key in _keys(numbers)]
        self._utc_of_zero = utc_of_zero

    def likeliest_by_differences(self) -> Iterator[Places]:
        """First guesses of each shot's file: by what times and numbers differ by most often."""
        for of_files, of_shots, within in self._scales():
            some = _spread(len(of_shots), _COMPARED // max(len(of_files), 1))
            for zero in _peaks(of_files[None, :] - of_shots[some, None], within):
                yield _nearest(of_files, of_shots + zero, within)

    def likeliest_by_ends(self) -> Iterator[Places]:
        """The same by what those at either end differ by: in long rows chance alone makes others come as often."""
        for of_files, of_shots, within in self._scales():
            files, shots = of_files[~np.isnan(of_files)], of_shots[~np.isnan(of_shots)]
            if of_files is self._arrived or not len(files) or not len(shots):
                continue  # of many that came together the ends tell nothing
            ends = [
                *(files[:1] - shots[:_AT_ENDS]),
                *(files[:_AT_ENDS] - shots[:1]),
                *(files[-1:] - shots[-_AT_ENDS:]),
                *(files[-_AT_ENDS:] - shots[-1:]),
            ]
            for zero in sorted({*ends}):
                yield _nearest(of_files, of_shots + zero, within)

    def expected(self, zeros: Zeros) -> Places:
        """For each shot the file that the surest of these rulers gives it; -1: none."""
        if zeros.numbers is not None:
            counts, numbers = list(self._pairs_of_numbers())[zeros.numbers[0]]
            return _nearest(numbers, counts + zeros.numbers[1], _WITHIN)
        for times, zero in ((self._captured, zeros.clock), (self._arrived, zeros.arrival)):
            if zero is not None:
                return _nearest(times, self._moments + zero[0], max(_WITHIN_S, zero[1]))
        return np.full(self.shots, -1)

    def _scales(self) -> Iterator[tuple[Floats, Floats, float]]:
        """What files and shots are compared by, and within what it agrees."""
        yield self._captured, self._moments, _WITHIN_S
        yield self._arrived, self._moments, _WITHIN_S
        for counts, numbers in self._pairs_of_numbers():
            yield numbers, counts, _WITHIN

    def zeros(self, file_of: Places) -> Zeros:
        """The zeros of all rulers that these pairs agree with."""
        shots = np.flatnonzero(file_of >= 0)
        files = file_of[shots]
        return Zeros(
            self._zero_of_numbers(shots, files),
            _zero_of(self._captured[files] - self._moments[shots], sharp_s=0.3),
            _zero_of(self._arrived[files] - self._moments[shots], sharp_s=0.5, is_delay=True),
        )

    def _zero_of_numbers(self, shots: Places, files: Places) -> tuple[int, float] | None:
        """The counter and number in the names that agree best, and by how much they differ."""
        found, agreeing = None, _LEAST - 1
        for place, (counts, numbers) in enumerate(self._pairs_of_numbers()):
            differ = numbers[files] - counts[shots]
            known = differ[~np.isnan(differ)]
            if len(known) < _LEAST:
                continue
            values, times = np.unique(known, return_counts=True)
            zero, most = values[times.argmax()], int(times.max())
            if most > agreeing and most >= _HALF * len(known):
                found, agreeing = (place, float(zero)), most
        return found

    def scores(self, zeros: Zeros, shots: Places, files: Places) -> Floats:
        """What speaks for each pair of these places, by all rulers."""
        scores = np.zeros(np.broadcast_shapes(shots.shape, files.shape))
        arrived = self._arrived[files] - self._moments[shots]
        if zeros.numbers is not None:
            counts, numbers = list(self._pairs_of_numbers())[zeros.numbers[0]]
            apart = numbers[files] - counts[shots] - zeros.numbers[1]
            scores += np.where(np.isnan(apart), 0.0, np.where(apart == 0, AGREES, _DIFFERS))
        if zeros.clock is not None:
            scores += _fitting(self._captured[files] - self._moments[shots], *zeros.clock)
        if zeros.arrival is not None:
            fits = _fitting(arrived, *zeros.arrival)
            scores += np.where(arrived > zeros.arrival[0], np.maximum(fits, np.log(_LATE)), fits)
        scores[arrived < _IMPOSSIBLE_S] = _NEVER
        return scores

    def prior(self, zeros: Zeros) -> float:
        """How likely such zeros are: delays are short, and a clock that is set is exact but for the time zone. What lacks in
        both rows by chance is taken off, for the alignment has not paid for it."""
        prior = _SAME_COUNT if zeros.numbers is not None and zeros.numbers[1] == 0 else 0.0
        if zeros.numbers is not None:
            counts, numbers = list(self._pairs_of_numbers())[zeros.numbers[0]]
            prior -= _MEETING * _met_by_chance(counts + zeros.numbers[1], numbers)
        if zeros.clock is not None and self._utc_of_zero is not None:
            off = (zeros.clock[0] - self._utc_of_zero + _ZONE_S / 2) % _ZONE_S - _ZONE_S / 2
            density = _IS_SET * np.exp(-0.5 * (off / _SET_S) ** 2) / (_SET_S * np.sqrt(2 * np.pi))
            prior += float(np.log(density * _ZONE_S + 1 - _IS_SET))
        if zeros.arrival is not None:
            delay = zeros.arrival[0]
            too_early, too_late = max(0.0, _EARLIEST_S - delay), max(0.0, delay - _LATEST_S)
            prior -= 2.0 * max(0.0, -delay) + 4.0 * too_early + 0.3 * too_late
        return prior

    def _pairs_of_numbers(self) -> Iterator[tuple[Floats, Floats]]:
        """Counters of the shots and numbers in the names that both vary."""
        for counts in filter(_varies, self._counts):
            for numbers in filter(_varies, self._numbers):
                yield counts, numbers


def _spread(count: int, most: int) -> Places:
    """So many of them at most, at uneven distances: even ones would agree with what comes at such distances."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


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


def _zero_of(apart: Floats, sharp_s: float, *, is_delay: bool = False) -> tuple[float, float] | None:
    """The usual difference of the pairs in seconds, and how far they scatter; None if they do not agree.

    A delay may scatter evenly: its densest half would be sharper by one shift of the rows than by another, and is no middle."""
    known = apart[~np.isnan(apart)]
    if len(known) < _LEAST:
        return None
    zero = _mode(known)
    some = known[np.abs(known - zero) < _NEAR_S]
    if is_delay and len(some):
        zero = float(np.median(some))
    off = np.abs(known - zero)
    near = off[off < _NEAR_S]
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


def _nearest(of_files: Floats, expected: Floats, within: float) -> Places:
    """For each shot the file that is nearest to what is expected of it, of equal ones the first; -1 if none is so near."""
    order = np.argsort(of_files, kind="stable")
    order = order[: int((~np.isnan(of_files)).sum())]  # what is not known comes last
    if not len(order):
        return np.full(len(expected), -1)
    known = of_files[order]
    after = np.searchsorted(known, expected)
    before = np.searchsorted(known, known[np.maximum(after - 1, 0)])
    after = np.minimum(after, len(known) - 1)
    nearest = np.where(np.abs(known[before] - expected) <= np.abs(known[after] - expected), before, after)
    return np.where(np.abs(known[nearest] - expected) <= within, order[nearest], -1)


def _met_by_chance(counts: Floats, numbers: Floats) -> float:
    """How many numbers lack in both rows, as far as chance explains it: where messages and files are lost independently, losses
    of the one meet losses of the other by every shift of the rows, and by some shift more than by the right one."""
    ours, theirs = (np.unique(one[~np.isnan(one)]) for one in (counts, numbers))
    first, last = max(ours[0], theirs[0]), min(ours[-1], theirs[-1])
    among = last - first + 1
    if not 1 <= among <= _SPARSE * (len(ours) + len(theirs)) or any(
        np.median(np.diff(one)) != 1 for one in (ours, theirs)
    ):
        return 0.0
    ours, theirs = (one[(one >= first) & (one <= last)] for one in (ours, theirs))
    met = among - len(np.union1d(ours, theirs))
    usual = (among - len(ours)) * (among - len(theirs)) / among
    return float(min(met, usual + 3 * np.sqrt(usual) + 2))


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


def _keys(rows: Sequence[Mapping[Key, int]]) -> list[Key]:
    """The keys that most have, at most a dozen: names are anybody's."""
    counted = Counter(key for row in rows for key in row)
    return [key for key, _ in counted.most_common(12)]


def _times(values: Iterator[float | int | None]) -> Floats:
    return np.array([np.nan if value is None else float(value) for value in values])
