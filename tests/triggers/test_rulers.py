"""What speaks for a shot and a file to belong together, and rows in order."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from gcs_mosaic.triggers import alignment
from gcs_mosaic.triggers import rulers as module
from gcs_mosaic.triggers.needleman_wunsch import LOST, LOST_AT_END, Band, needleman_wunsch, whole
from gcs_mosaic.triggers.rulers import AGREES, ARRIVAL, CLOCK, NUMBERS, FileClue, Rulers, ShotClue, Zeros

NAN = math.nan
NUMBER = ("img_#", 0)


def rulers(
    moments: list[float],
    *,
    counts: list[int | None] | None = None,
    numbers: list[int | None] | None = None,
    captured: list[float | None] | None = None,
    arrived: list[float | None] | None = None,
    utc_of_zero: float | None = None,
) -> Rulers:
    count = max(len(one) for one in (numbers, captured, arrived) if one is not None)
    told = counts or [None] * len(moments)
    shots = [ShotClue(at, {} if n is None else {"counter": n}) for at, n in zip(moments, told, strict=True)]
    rows = zip(numbers or [None] * count, captured or [None] * count, arrived or [None] * count, strict=True)
    files = [FileClue({} if n is None else {NUMBER: n}, when, came) for n, when, came in rows]
    return Rulers(shots, files, utc_of_zero)


def zeros(*, numbers: float | None = None, clock: float | None = None, arrival: float | None = None) -> Zeros:
    return Zeros(
        None if numbers is None else (0, numbers),
        None if clock is None else (clock, 0.3),
        None if arrival is None else (arrival, 0.5),
    )


EVEN = [10.0 * k for k in range(6)]
PAIRED = np.arange(6)


def test_the_zeros_are_what_pairs_differ_by() -> None:
    found = rulers(
        EVEN,
        counts=[1, 2, 3, 4, 5, 6],
        numbers=[41, 42, 43, 44, 45, 49],
        captured=[at + 3600 for at in EVEN],
        arrived=[at + 1.5 for at in EVEN],
    ).zeros(PAIRED)
    assert found == Zeros((0, 40.0), (3600.0, 0.3), (1.5, 0.5))
    assert found.told_by == (NUMBERS, CLOCK, ARRIVAL)


@pytest.mark.parametrize(("agree", "told"), [(4, True), (3, False)])
def test_a_number_that_most_pairs_do_not_agree_with_is_no_ruler(agree: int, told: bool) -> None:
    numbers: list[int | None] = [40 + k if k < agree else 90 + 7 * k for k in range(6)]
    found = rulers(EVEN, counts=[*range(6)], numbers=numbers).zeros(PAIRED)
    assert found.numbers == ((0, 40.0) if told else None)


@pytest.mark.parametrize(("known", "told"), [(3, True), (2, False)])
def test_three_pairs_at_least_tell_a_zero(known: int, told: bool) -> None:
    captured: list[float | None] = [at + 5.0 if k < known else None for k, at in enumerate(EVEN)]
    assert (rulers(EVEN, captured=captured).zeros(PAIRED).clock is not None) is told
    of_three = rulers(EVEN, counts=[*range(6)], numbers=[40, 41, 42, 43, 44, 45])
    pairs = np.where(known > PAIRED, PAIRED, -1)
    assert (of_three.zeros(pairs).numbers is not None) is told


@pytest.mark.parametrize(("near", "told"), [(4, True), (3, False)])
def test_a_clock_that_most_pairs_do_not_agree_with_is_none(near: int, told: bool) -> None:
    captured: list[float | None] = [at + (5.0 if k < near else 100.0 * k) for k, at in enumerate(EVEN)]
    assert (rulers(EVEN, captured=captured).zeros(PAIRED).clock is not None) is told


def test_of_a_clock_without_seconds_the_scatter_is_known() -> None:
    """Its deviation is 1.48 times the usual one."""
    captured: list[float | None] = [at + 50.0 + off for at, off in zip(EVEN, (-1.0, 1.0, -1.0, 1.0, 0, 0), strict=True)]
    found = rulers(EVEN, captured=captured).zeros(PAIRED).clock
    assert found is not None
    assert found[0] == pytest.approx(50.0, abs=1.0)
    assert found[1] >= 1.0


def test_times_that_scatter_no_better_than_chance_are_no_clock() -> None:
    assert module._zero_of(np.array([0.0, 0.2, 0.24, 5.0]), 0.3) == (0.22, 0.3)
    assert module._zero_of(np.array([0.0, 50.0, 100.0]), 0.3) is None
    assert module._zero_of(np.array([0.0, 0.1]), 0.3) is None
    assert module._zero_of(np.array([0.0, NAN, NAN, 0.1]), 0.3) is None


def test_what_each_ruler_says_of_a_pair_is_added() -> None:
    some = rulers(
        [0.0], counts=[1], numbers=[41], captured=[100.0], arrived=[1.0]
    )  # one shot and file: no number varies, so it says nothing
    at = np.array([0]), np.array([0])
    fits = [math.log(0.999 * 30 / (sigma * math.sqrt(2 * math.pi)) + 0.001) for sigma in (0.3, 0.5)]
    assert some.scores(zeros(clock=100.0), *at)[0] == pytest.approx(fits[0])
    assert some.scores(zeros(clock=100.0, arrival=1.0), *at)[0] == pytest.approx(sum(fits))
    assert some.scores(zeros(clock=140.0), *at)[0] == pytest.approx(math.log(0.001))
    assert some.scores(zeros(), *at)[0] == 0.0


def test_a_number_agrees_or_differs_or_is_not_known() -> None:
    some = rulers(EVEN, counts=[1, 2, 3, 4, 5, None], numbers=[41, 42, 43, 44, 46, 47])
    found = some.scores(zeros(numbers=40.0), PAIRED, PAIRED)
    assert found.tolist() == [AGREES] * 4 + [-6.0, 0.0]


@pytest.mark.parametrize(("early", "score"), [(9.9, 0.0), (10.1, -100.0)])
def test_a_file_that_came_long_before_a_shot_is_another_ones(early: float, score: float) -> None:
    some = rulers([100.0], arrived=[100.0 - early])
    assert some.scores(zeros(), np.array([0]), np.array([0])).tolist() == [score]


@pytest.mark.parametrize(
    ("delay", "prior"), [(0.0, 0.0), (3.0, 0.0), (15.0, 0.0), (20.0, -1.5), (-1.0, -2.0), (-2.5, -9.0)]
)
def test_delays_are_short_and_files_come_after_their_shots(delay: float, prior: float) -> None:
    assert rulers(EVEN, arrived=[None]).prior(zeros(arrival=delay)) == pytest.approx(prior)


def test_a_clock_that_is_set_is_exact_but_for_the_time_zone() -> None:
    some = rulers(EVEN, captured=[None], utc_of_zero=1_000_000.0)
    exact, zone, off, late = (some.prior(zeros(clock=1_000_000.0 + by)) for by in (0.0, -3600.0, 450.0, 1.0))
    assert exact == zone == pytest.approx(math.log(0.5 * 900 / math.sqrt(2 * math.pi) + 0.5))
    assert off == pytest.approx(math.log(0.5))
    assert late == pytest.approx(math.log(0.5 * 900 * math.exp(-0.5) / math.sqrt(2 * math.pi) + 0.5))
    assert rulers(EVEN, captured=[None]).prior(zeros(clock=450.0)) == 0.0


def test_a_number_that_is_the_counters_own_is_likelier() -> None:
    some = rulers(EVEN, counts=[*range(6)], numbers=[*range(6)])
    assert some.prior(zeros(numbers=0.0)) == 0.5
    assert some.prior(zeros(numbers=1.0)) == 0.0


@pytest.mark.parametrize(
    ("values", "varies"),
    [
        ([1, 2, 3], True),
        ([1, 2], False),
        ([1, 2, 2], False),
        ([1, 2, 3, 3, 3, 3], True),
        ([1, 2, 3, 3, 3, 3, 3], False),
    ],
)
def test_a_counter_is_what_mostly_differs(values: list[float], varies: bool) -> None:
    assert module._varies(np.array([*values, NAN])) is varies


@pytest.mark.parametrize(
    ("expected", "found"),
    [(1.0, 1), (1.4, 1), (1.5, 1), (1.6, 2), (2.51, 2), (2.61, -1), (-0.5, 0), (-0.7, -1), (NAN, -1)],
)
def test_the_nearest_file_is_found_if_it_is_near(expected: float, found: int) -> None:
    files = np.array([0.0, 1.0, 2.0, NAN])
    assert module._nearest(files, np.array([expected]), 0.6).tolist() == [found]
    assert module._nearest(files[3:], np.array([expected]), 0.6).tolist() == [-1]


def test_of_equal_files_the_first_is_the_nearest() -> None:
    files = np.array([5.0, 1.0, 1.0, 1.0])
    assert module._nearest(files, np.array([0.9, 1.0, 1.2]), 0.6).tolist() == [1, 1, 1]


def test_the_densest_differences_are_tried_each_once() -> None:
    apart = np.array([[0.0, 0.1, 0.2, 50.0], [7.0, 7.3, NAN, 90.0]])
    assert module._peaks(apart, 0.7)[:2] == pytest.approx([0.1, 7.15])
    assert len(module._peaks(np.arange(40.0)[None] * 5, 0.7)) == 10
    assert module._peaks(np.array([[NAN]]), 0.7) == []


def test_many_are_thinned_out_unevenly() -> None:
    assert module._spread(5, 5).tolist() == [0, 1, 2, 3, 4]
    some = module._spread(1000, 50)
    assert len(np.unique(some)) == 50
    assert (np.diff(some) > 0).all()
    assert len(np.unique(np.diff(some))) > 5


def test_numbers_that_lack_in_both_rows_are_those_that_chance_explains() -> None:
    """Of 20 five lack in each, three of them in both: chance explains 1.25 and three deviations and two more."""
    ours = np.array([float(n) for n in range(20) if n not in (3, 7, 11, 13, 15)])
    theirs = np.array([float(n) for n in range(20) if n not in (3, 7, 11, 5, 9)])
    assert module._met_by_chance(ours, theirs) == 3.0
    six = np.array([*range(8), *range(14, 20)], float)
    assert module._met_by_chance(six, six) == 6.0 == pytest.approx(min(6.0, 1.8 + 3 * math.sqrt(1.8) + 2))
    twelve = np.array([*range(24), *range(36, 60)], float)
    assert module._met_by_chance(twelve, twelve) == pytest.approx(2.4 + 3 * math.sqrt(2.4) + 2)
    assert module._met_by_chance(np.arange(5.0), np.arange(5.0) + 100) == 0.0
    assert module._met_by_chance(np.arange(5.0) * 2, np.arange(5.0) * 2) == 0.0


def test_the_surest_ruler_tells_where_files_are_expected() -> None:
    some = rulers(
        EVEN,
        counts=[*range(6)],
        numbers=[40, 41, 42, 43, 44, 45],
        captured=[*EVEN[1:], 99.0],
        arrived=[*EVEN[2:], 98, 99],
    )
    assert some.expected(zeros(numbers=40.0, clock=0.0, arrival=0.0)).tolist() == [0, 1, 2, 3, 4, 5]
    assert some.expected(zeros(clock=0.0, arrival=0.0)).tolist() == [-1, 0, 1, 2, 3, 4]
    assert some.expected(zeros(arrival=0.0)).tolist() == [-1, -1, 0, 1, 2, 3]
    assert some.expected(zeros()).tolist() == [-1] * 6


def best_of_all(scores: np.ndarray) -> float:
    """By looking at every set of pairs in order. Where both rows have lost some at one end, the fewer are none at the end."""
    shots, files = scores.shape
    best: float = LOST_AT_END * (shots + files)
    for count in range(1, min(shots, files) + 1):
        for some in itertools.combinations(range(shots), count):
            for other in itertools.combinations(range(files), count):
                ends = max(some[0], other[0]) + max(shots - 1 - some[-1], files - 1 - other[-1])
                lost = shots + files - 2 * count
                total = sum(float(scores[pair]) for pair in zip(some, other, strict=True))
                best = max(best, total + LOST_AT_END * ends + LOST * (lost - ends))
    return best


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("shots", "files"), [(1, 1), (1, 4), (4, 1), (3, 4), (5, 5), (5, 3)])
def test_the_best_alignment_is_the_best_of_all(shots: int, files: int, seed: int) -> None:
    scores = np.random.default_rng(seed).normal(-3, 4, (shots, files))
    total, file_of = needleman_wunsch(scores, whole(shots, files))
    assert total == pytest.approx(best_of_all(scores))
    paired = file_of[file_of >= 0]
    assert (np.diff(paired) > 0).all()


@pytest.mark.parametrize("lost", [[], [0], [7], [3, 4], [11]])
def test_a_band_finds_what_all_pairs_do(lost: list[int]) -> None:
    """Twelve shots, of each of which four files are looked at, that go along."""
    there = [n for n in range(12) if n not in lost]
    scores = np.full((12, len(there)), -6.0)
    scores[there, np.arange(len(there))] = 3.0
    first = np.clip(np.arange(12) - 2, 0, len(there) - 4)
    band = Band(first, 4, len(there))
    total, file_of = needleman_wunsch(scores[band.places], band)
    expected, all_files = needleman_wunsch(scores, whole(12, len(there)))
    assert total == pytest.approx(expected)
    assert file_of.tolist() == all_files.tolist()


def test_of_long_rows_only_so_many_differences_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[tuple[int, ...]] = []
    monkeypatch.setattr(module, "_COMPARED", 600)

    def peaks(apart: np.ndarray, within: float) -> list[float]:
        compared.append(apart.shape)
        return []

    monkeypatch.setattr(module, "_peaks", peaks)
    [*rulers([float(k) for k in range(40)], captured=[float(k) for k in range(30)]).likeliest_by_differences()]
    assert compared == [(20, 30)] * 2


def places(*files: int) -> np.ndarray:
    return np.array(files)


@pytest.mark.parametrize(
    ("best", "other", "files", "pairs"),
    [
        (places(0, 1, 2, 3), places(0, 1, -1, -1), 4, 0.0),  # nothing is lost: no luck
        (places(0, 1, 2, -1), places(0, 1, -1, -1), 4, 1.0),
        (places(0, 1, 2, -1), places(0, -1, -1, -1), 4, 2.0),
        (places(0, 1, 2, -1), places(-1, -1, -1, -1), 4, 2 * math.sqrt(2)),
        (places(0, 1, -1, -1), places(1, 2, -1, -1), 4, 0.0),
        (places(0, -1, -1, -1), places(1, 2, 3, -1), 4, 0.0),
    ],
)
def test_only_so_many_of_the_pairs_that_are_more_are_luck(
    best: np.ndarray, other: np.ndarray, files: int, pairs: float
) -> None:
    """Twice the root of what is lost."""
    assert alignment._lucky(best, other, files) == pytest.approx((2 * -LOST + AGREES + 3.2) * pairs)


@pytest.mark.parametrize(
    ("shots", "files", "shifts"),
    [(3, 3, [0, -1, 1]), (2, 2, [0]), (1, 4, [0, -1, -2, -3]), (4, 1, [0, 1, 2, 3]), (3, 4, [0, -1, 1, -2])],
)
def test_rows_are_shifted_by_what_they_differ_and_a_little_more(shots: int, files: int, shifts: list[int]) -> None:
    assert alignment._shifts(shots, files) == shifts
    assert len(alignment._shifts(40, 40)) == 13


def test_a_shift_of_a_row() -> None:
    assert alignment._shifted(1, 4, 3).tolist() == [-1, 0, 1, 2]
    assert alignment._shifted(-1, 4, 3).tolist() == [1, 2, -1, -1]
    assert alignment._file_of([(0, 2), (3, 0)], 4).tolist() == [2, -1, -1, 0]


def explained(*files: int) -> alignment._Explained:
    return alignment._Explained(0.0, places(*files), ())


@pytest.mark.parametrize(
    ("best", "other", "apart", "shift"),
    [
        (explained(0, 1, 2), explained(0, 1, 2), 0, 0),
        (explained(0, 1, 2, -1), explained(-1, 0, 1, 2), 2, 1),
        (explained(-1, 0, 1, 2), explained(0, 1, 2, -1), 2, -1),
        (explained(0, 1, 2, 3, -1), explained(0, -1, 1, 2, 3), 2, 1),
        (explained(-1, -1), explained(0, 1), 0, 0),
    ],
)
def test_how_far_two_explanations_are_apart(
    best: alignment._Explained, other: alignment._Explained, apart: int, shift: int
) -> None:
    assert (alignment._apart(best, other), alignment._shift(best, other)) == (apart, shift)
