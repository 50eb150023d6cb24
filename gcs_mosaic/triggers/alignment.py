"""The likeliest way in which a stretch of shots and files belong together, and whether another one is about as good. Pure.

Shots and files are two rows in order, from each of which some are lost. What speaks for a pair is measured with `rulers`. Their
zeros are not known, so every shift of the rows gives one, the rows are aligned by it (`needleman_wunsch`), and the likelihoods of
the results are compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gcs_mosaic.triggers.needleman_wunsch import LOST, LOST_AT_END, Band, Places, needleman_wunsch, whole
from gcs_mosaic.triggers.rulers import AGREES, ARRIVAL, CLOCK, FileClue, Rulers, ShotClue, Zeros

Pairs: TypeAlias = frozenset[tuple[int, int]]
"""Places of a shot and its file."""

MOST = 800  # shots and files of which every pair is looked at; of longer rows a band
LONGEST = 5000  # shots and files that are aligned together
_BAND = 257  # files that are looked at for each shot of a long row
_GROUP = 51  # pairs whose middle is a place on the band's line: strangers among them do not bend it
SURE = 5.0  # an explanation less likely by a factor of e^5 is none
_SURE_BY_ORDER = 8.0  # ... of e^8, where no time tells how far the rows are shifted and some of them are lost
_SHIFTS = 6  # tried either way, beyond those that the lengths of the rows differ by
_REFINED = 6  # best shifts that are aligned again by the zeros found
_STRANGERS = -2.0  # a pair less likely than chance by more is left out
_MORE = 2 * -LOST + AGREES + 3.2  # what one more pair brings: nothing is lost, number and time agree
_BY_CHANCE = 2.0  # times the root of what is lost: pairs by which a wrong shift may be ahead
_KEPT_APART = 1.0  # by which pairs of the best alignment are made worse, to find the next best


@dataclass(frozen=True, slots=True)
class Alignment:
    """`pairs`: places of a shot and its file, in order. `shifts`: by how many shots later (or earlier) each file may as well
    belong; `unsure`: how many pairs that concerns. `told_by`: the rulers, for display.

    Of the changes from the pairs so far, each judged by itself: `sure` are surely to be made, `refuted` to be undone, and so many
    are `contested`: what there is is less likely, but not by enough."""

    pairs: list[tuple[int, int]]
    shifts: tuple[int, ...]
    unsure: int
    told_by: tuple[str, ...]
    score: float
    better_by: float | None = None  # than the pairs so far
    sure: Pairs = frozenset()
    refuted: Pairs = frozenset()
    contested: int = 0


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
    """Align two rows, each in the order of capture; at most `LONGEST` of each. `utc_of_zero`: UTC at the zero of the moments.

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
    pairs = _pairs(best.file_of)
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
    sure, refuted, contested = _settled(rows.changes(best, likely, known), rivals)
    return Alignment(
        sorted(likely), tuple(sorted(shifts)), unsure, best.told_by, best.score, better_by, sure, refuted, contested
    )


@dataclass(frozen=True, slots=True)
class _Change:
    """Pairs that go only together: one of them takes what another one had."""

    made: Pairs
    undone: Pairs
    gain: float


class _Rows:
    """Both rows, and explanations of how they belong together."""

    def __init__(self, shots: Sequence[ShotClue], files: Sequence[FileClue], utc_of_zero: float | None) -> None:
        self._rulers = Rulers(shots, files, utc_of_zero)
        self._shots, self._files = len(shots), len(files)
        self._explained: dict[Zeros, _Explained] = {}

    def guesses(self) -> Iterator[Places]:
        """First guesses of each shot's file: by shifts of the rows, and by what times and numbers differ by most often."""
        if self._is_long:  # in which losses shift more than one guess for all of it could stand
            yield from self._rulers.likeliest_by_ends()
        else:
            for shift in _shifts(self._shots, self._files):
                yield _shifted(shift, self._shots, self._files)
        yield from self._rulers.likeliest_by_differences()

    @property
    def _is_long(self) -> bool:
        return max(self._shots, self._files) > MOST

    def _band(self, zeros: Zeros) -> Band:
        """The pairs that are looked at: all, or in long rows those about the line on which such zeros put them."""
        if not self._is_long or self._files <= _BAND:
            return whole(self._shots, self._files)
        expected = self._rulers.expected(zeros)
        shots = np.flatnonzero(expected >= 0)
        groups = [shots[k : k + _GROUP] for k in range(0, len(shots), _GROUP)]
        at = [float(np.median(group)) for group in groups] or [0.0, self._shots - 1.0]
        line = [float(np.median(expected[group])) for group in groups] or [0.0, self._files - 1.0]
        middle = np.interp(np.arange(self._shots), at, np.maximum.accumulate(line))
        first = np.clip(np.rint(middle) - _BAND // 2, 0, self._files - _BAND).astype(np.int64)
        return Band(first, _BAND, self._files)

    def explain(self, file_of: Places) -> _Explained:
        """Align by the zeros that a first guess of the pairs gives."""
        zeros = self._rulers.zeros(file_of)
        if zeros not in self._explained:
            band = self._band(zeros)
            total, aligned = needleman_wunsch(self._rulers.scores(zeros, *band.places), band)
            self._explained[zeros] = _Explained(total + self._rulers.prior(zeros), aligned, zeros.told_by)
        return self._explained[zeros]

    def refined(self, guesses: Sequence[Places]) -> list[_Explained]:
        """Explanations by these first guesses, and by what the best of them give, the likeliest first."""
        explained = [self.explain(guess) for guess in guesses]
        explained.sort(key=lambda one: -one.score)  # stable: of equals the smallest shift
        for _ in range(2):
            explained += [self.explain(one.file_of) for one in explained[:_REFINED]]
            explained.sort(key=lambda one: -one.score)
        return explained

    def likely(self, best: _Explained) -> Pairs:
        """The pairs that are no worse than chance: between two losses strangers may have been left beside each other."""
        pairs = _pairs(best.file_of)
        return frozenset(pair for pair, score in self._scored(best, pairs).items() if score > _STRANGERS)

    def changes(self, best: _Explained, made: Pairs, known: Places | None) -> list[_Change]:
        """From the known pairs to these, by the zeros of the best, each with what it gains by itself."""
        so_far = frozenset() if known is None else frozenset(_pairs(known))
        scores = self._scored(best, sorted(made ^ so_far))
        return [
            _Change(
                made=together & made,
                undone=together & so_far,
                gain=sum((scores[pair] - 2 * LOST) * (1 if pair in made else -1) for pair in together),
            )
            for together in _connected(scores)
        ]

    def _scored(self, best: _Explained, pairs: Sequence[tuple[int, int]]) -> dict[tuple[int, int], float]:
        places = np.array(pairs, np.int64).reshape(-1, 2)
        scores = self._rulers.scores(self._rulers.zeros(best.file_of), places[:, 0], places[:, 1])
        return dict(zip(pairs, scores.tolist(), strict=True))

    def score_of(self, file_of: Places) -> float:
        """How likely these pairs are, in whatever order; what is lost at an end costs as in the middle of a row, or less."""
        zeros = self._rulers.zeros(file_of)
        shots = np.flatnonzero(file_of >= 0)
        files = file_of[shots]
        scores, prior = self._rulers.scores(zeros, shots, files), self._rulers.prior(zeros)
        lost = self._shots + self._files - 2 * len(shots)
        at_ends = 0
        if len(shots):
            at_ends = int(shots[0] + self._shots - 1 - shots[-1] + files.min() + self._files - 1 - files.max())
        return float(scores.sum() + prior + LOST * (lost - at_ends) + LOST_AT_END * at_ends)

    def better_by(self, best: _Explained, known: Places) -> float:
        """By how much the best is likelier than the known pairs, and than these where a few of them are mended by the rest."""
        mended = self.explain(known)
        better = best.score - self.score_of(known)
        if _apart(best, mended) == 0:
            return better  # by the zeros of the known ones themselves, so by no luck
        better -= _lucky(best.file_of, known, self._files)
        return min(better, best.score - mended.score - _lucky(best.file_of, mended.file_of, self._files))

    def next_best(self, best: _Explained) -> _Explained:
        """The same zeros, but with as few of these pairs as that is worth it."""
        zeros = self._rulers.zeros(best.file_of)
        band = self._band(zeros)
        places = band.places
        apart = self._rulers.scores(zeros, *places)
        apart[places[1] == best.file_of[:, None]] -= _KEPT_APART
        total, aligned = needleman_wunsch(apart, band)
        kept = int(((aligned == best.file_of) & (aligned >= 0)).sum())
        return _Explained(total + _KEPT_APART * kept + self._rulers.prior(zeros), aligned, zeros.told_by)


def _shifts(shots: int, files: int) -> list[int]:
    """Shots by which the first file may lie off, the smallest first."""
    beyond, most = shots - files, min(_SHIFTS, max(min(shots, files) - 2, 0))
    return sorted(range(min(beyond, 0) - most, max(beyond, 0) + most + 1), key=abs)


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


def _settled(changes: Sequence[_Change], rivals: Sequence[_Explained]) -> tuple[Pairs, Pairs, int]:
    """What is surely to be made and undone, and how many pairs may be wrong."""
    every = frozenset(pair for one in changes for pair in one.made)
    allowed = every.intersection(*(_allowed(rival, every) for rival in rivals))
    surely = [one for one in changes if one.gain > SURE and one.made <= allowed]
    perhaps = [one for one in changes if one.undone and one.gain > 0 and one not in surely]
    made = frozenset(pair for one in surely for pair in one.made)
    undone = frozenset(pair for one in surely for pair in one.undone)
    return made, undone, sum(max(len(one.made), len(one.undone)) for one in perhaps)


def _pairs(file_of: Places) -> list[tuple[int, int]]:
    return [(shot, int(file)) for shot, file in enumerate(file_of) if file >= 0]


def _allowed(one: _Explained, pairs: Pairs) -> Pairs:
    """Those of the pairs of which this explanation gives neither to another one."""
    own = _pairs(one.file_of)
    shots, files = {shot for shot, _ in own}, {file for _, file in own}
    return frozenset(own) | {(shot, file) for shot, file in pairs if shot not in shots and file not in files}


def _connected(pairs: Iterable[tuple[int, int]]) -> list[Pairs]:
    """The pairs by what they share a shot or a file with."""
    of_shot, of_file = dict[int, list[tuple[int, int]]](), dict[int, list[tuple[int, int]]]()
    for pair in pairs:
        of_shot.setdefault(pair[0], []).append(pair)
        of_file.setdefault(pair[1], []).append(pair)
    found, seen = list[Pairs](), set[tuple[int, int]]()
    for pair in [pair for row in of_shot.values() for pair in row]:
        together, ahead = set[tuple[int, int]](), [pair]
        while ahead:
            one = ahead.pop()
            if one not in seen:
                seen.add(one)
                together.add(one)
                ahead += of_shot[one[0]] + of_file[one[1]]
        if together:
            found.append(frozenset(together))
    return found


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
