"""Which shots and files belong together, by all that is known of a stretch."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from gcs_mosaic.triggers.alignment import align
from gcs_mosaic.triggers.names import numbers_in, stem_of
from gcs_mosaic.triggers.rulers import FileClue, ShotClue
from tests.triggers.stretches import KINDS, aligned, stretch

IRREGULAR = [0.0, 3.0, 5.0, 11.0, 13.0, 20.0, 24.0, 25.5, 31.0, 36.0]
REGULAR = [4.0 * k for k in range(10)]


def shots(moments: list[float]) -> list[ShotClue]:
    return [ShotClue(at, {"counter": k + 1}) for k, at in enumerate(moments)]


def files(names: list[str], captured: list[float] | None = None) -> list[FileClue]:
    times: Sequence[float | None] = captured or [None] * len(names)
    return [FileClue(numbers_in(name), time) for name, time in zip(names, times, strict=True)]


def dsc(*numbers: int) -> list[str]:
    return [f"DSC{number:05d}.JPG" for number in numbers]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "numbers"])
def test_of_simulated_stretches_hardly_a_pair_is_wrong_and_not_said_to_be(kind: str) -> None:
    """A dozen of each kind here, five hundred in benchmarks/pairs_of_stretches.py; numbers alone cannot tell a test shot."""
    right = possible = unsaid = 0
    for seed in range(12):
        made = stretch(seed, KINDS[kind])
        found = aligned(made)
        good, wrong, could = made.outcome(found)
        right, possible, unsaid = right + good, possible + could, unsaid + (0 if found.unsure else wrong)
    assert right >= 0.97 * possible
    assert unsaid <= 0.005 * possible


@pytest.mark.parametrize("moments", [IRREGULAR, REGULAR])
@pytest.mark.parametrize("ahead", [0.0, 7200.0, -18_000.4, 1234.5])
def test_a_test_shot_with_a_number_of_its_own_shifts_no_pair(moments: list[float], ahead: float) -> None:
    """Tried in a replay: by numbers alone either shift is as good, and every pair was one off; the camera's clock tells."""
    captured = [moments[0] - 120 + ahead, *(at + 0.3 + ahead for at in moments)]
    found = align(shots(moments), files(dsc(*range(41, 52)), [float(round(time)) for time in captured]), 0.0)
    assert found.pairs == [(k, k + 1) for k in range(10)]
    assert not found.unsure


def test_without_the_cameras_clock_a_test_shot_makes_it_ambiguous() -> None:
    found = align(shots(REGULAR), files(dsc(*range(41, 52))))
    assert found.unsure
    assert {*found.shifts} & {1, -1}


def test_two_lost_files_leave_two_shots_without() -> None:
    found = align(shots(IRREGULAR), files(dsc(42, 43, 44, 46, 47, 48, 49, 50)))
    assert [shot for shot, _ in found.pairs] == [0, 1, 2, 4, 5, 6, 7, 8] or found.unsure
    timed = [IRREGULAR[k] + 99 for k in (1, 2, 3, 5, 6, 7, 8, 9)]
    sure = align(shots(IRREGULAR), files(dsc(42, 43, 44, 46, 47, 48, 49, 50), timed))
    assert [shot for shot, _ in sure.pairs] == [1, 2, 3, 5, 6, 7, 8, 9]
    assert not sure.unsure


@pytest.mark.parametrize(
    "name", ["frame_{:06d}_1920x1080.jpg", "20250601_{:04d}.jpg", "v2_{:d}_4k_60fps.jpg", "{:03d}-of-500-1080p.jpg"]
)
def test_a_number_that_stays_the_same_is_none_of_the_shots(name: str) -> None:
    found = align(shots(IRREGULAR), files([name.format(13 + k) for k in range(10)]))
    assert found.pairs == [(k, k) for k in range(10)]
    lost = align(shots(IRREGULAR), files([name.format(13 + k) for k in range(10) if k not in (4, 7)]))
    assert [shot for shot, _ in lost.pairs] == [0, 1, 2, 3, 5, 6, 8, 9]


def test_a_clock_that_does_not_agree_is_no_witness() -> None:
    """All files bear one time: that of the editor which has written them."""
    found = align(shots(IRREGULAR), files(dsc(*range(42, 52)), [77.0] * 10))
    assert found.pairs == [(k, k) for k in range(10)]
    assert "clock" not in " ".join(found.told_by)


def test_nothing_is_paired_with_nothing() -> None:
    assert align([], files(dsc(1, 2))).pairs == []
    assert align(shots(REGULAR), []).pairs == []


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("DSC00501.ARW", "DSC00501.JPG"),
        ("dsc00501.arw", "DSC00501.JPG"),
        ("DJI_0001.JPG", "DJI_0001_W.JPG"),
        ("DJI_0001_T.JPG", "DJI_0001_W.JPG"),
        ("IMG_7.dng", "IMG_7-edited.jpeg"),
        ("IMG_7.jpg", "IMG_7 (2).jpg"),
        ("a.jpg", "A.TIF"),
    ],
)
def test_names_of_one_shot_have_one_stem(one: str, other: str) -> None:
    assert stem_of(one) == stem_of(other)


@pytest.mark.parametrize(
    ("one", "other"), [("DSC00501.JPG", "DSC00502.JPG"), ("A1.JPG", "B1.JPG"), ("A-x.jpg", "A-y.jpg")]
)
def test_names_of_two_shots_have_two(one: str, other: str) -> None:
    assert stem_of(one) != stem_of(other)


@pytest.mark.parametrize("shift", [-2, -1, 1, 2])
@pytest.mark.parametrize("seed", range(6))
def test_losses_that_meet_by_a_wrong_shift_are_no_evidence_for_it(shift: int, seed: int) -> None:
    """Each message that was lost meets a lost file, if all is so many shots off: by one pair more each, and by chance."""
    dice = random.Random(seed)
    lost = dice.sample(range(4, 26), dice.randint(2, 5))
    untold = {one + shift for one in dice.sample(lost, dice.randint(1, min(3, len(lost))))}
    told = [k for k in range(30) if k not in untold]
    there = [k for k in range(30) if k not in lost]
    found = align([ShotClue(4.0 * k, {"counter": k + 1}) for k in told], files(dsc(*(41 + k for k in there))))
    by = {there[file] - told[shot] for shot, file in found.pairs}
    assert by == {0} or found.unsure, f"each pair is {by} off, and nothing is said"
    if by != {0}:
        assert shift in found.shifts or -shift in found.shifts
