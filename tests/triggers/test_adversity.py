"""What goes wrong with files, for each reason by which they are matched. 20 shots, one each 2 s, from shot 0 at 0 s."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from gcs_mosaic.messages import CaptureResult, Source, TriggerEvent
from gcs_mosaic.triggers import How, Matched, Outcome, Pairing, Unmatched
from tests.factories import frame, trigger_event

COUNT, EVERY_S = 20, 2.0
CAMERA, TAKEN = Source.IMAGE_CAPTURED_BY_CAMERA, CaptureResult.TAKEN
AFTER_LANDING = {shot: 700.0 + 0.1 * shot for shot in range(COUNT)}

Name = Callable[[int], str]


@dataclass(frozen=True)
class Kind:
    """What connects a shot with its file."""

    how: How
    name: Name  # of the file of a shot
    hint: Name = lambda shot: ""
    count: Callable[[int], int | None] = lambda shot: 300 + shot


NAMES = Kind(How.NAME, lambda shot: f"DCIM/{chr(65 + shot)}-x.jpg", lambda shot: f"{chr(65 + shot)}-X.JPG")
COUNTERS = Kind(How.SEQUENCE, lambda shot: f"IMG_{7000 + shot}.JPG")
TIMES = Kind(How.TIME, lambda shot: f"{chr(65 + shot)}-y.jpg", count=lambda shot: None)
ALL = pytest.mark.parametrize("kind", [NAMES, COUNTERS, TIMES], ids=lambda kind: kind.how.name)
SURE = pytest.mark.parametrize("kind", [NAMES, COUNTERS], ids=lambda kind: kind.how.name)


def event(kind: Kind, shot: int) -> TriggerEvent:
    sequence, hint = kind.count(shot), kind.hint(shot) or None
    return trigger_event(sequence, EVERY_S * shot, component=100, source=CAMERA, result=TAKEN, file_hint=hint)


def flown(kind: Kind, comes: dict[int, float], extra: dict[str, float] | None = None) -> tuple[Pairing, dict[int, str]]:
    """A flight in which the file of each shot in `comes` is there at that time; event id -> name of its frame."""
    happened: list[tuple[float, int, str | None]] = [(EVERY_S * shot, shot, None) for shot in range(COUNT)]
    happened += [(at, COUNT, kind.name(shot)) for shot, at in comes.items()]
    happened += [(at, COUNT, name) for name, at in (extra or {}).items()]
    pairing = Pairing()
    outcomes: list[Outcome] = []
    for now, shot, name in sorted(happened, key=lambda item: item[0]):
        outcomes += pairing.tick(now)
        if name is None:
            outcomes += pairing.event(shot, event(kind, shot), now, now)
        else:
            outcomes += pairing.frame(frame(name, now), now)
    outcomes += pairing.close()
    ended = dict[int, str]()
    for outcome in outcomes:
        if isinstance(outcome, Matched):
            ended[outcome.event_id] = outcome.frame.name
        elif isinstance(outcome, Unmatched):
            del ended[outcome.event_id]
    accounts = pairing.accounts()
    assert (accounts.matched, accounts.events, accounts.pending) == (len(ended), COUNT, 0)
    assert accounts.frames == len(comes) + len(extra or {})
    return pairing, ended


def right(kind: Kind, shots: range | list[int] = range(COUNT)) -> dict[int, str]:
    return {shot: kind.name(shot) for shot in shots}


def soon(*without: int, late: float = 0.7) -> dict[int, float]:
    return {shot: EVERY_S * shot + late for shot in range(COUNT) if shot not in without}


@ALL
@pytest.mark.parametrize("late", [0.2, 1.9, 4.3])
def test_files_that_come_late(kind: Kind, late: float) -> None:
    assert flown(kind, soon(late=late))[1] == right(kind)


@ALL
def test_files_that_never_come(kind: Kind) -> None:
    pairing, ended = flown(kind, soon(6, 7, 13))
    assert ended == right(kind, [shot for shot in range(COUNT) if shot not in (6, 7, 13)])
    assert pairing.accounts().missing == 3


@ALL
def test_files_that_nobody_told_of(kind: Kind) -> None:
    extra = {"sub/thumb-a.png": 8.9, "sub/other-b.png": 21.0}
    pairing, ended = flown(kind, soon(), extra)
    assert ended == right(kind)
    assert pairing.accounts().orphans == 2


@SURE
def test_files_in_another_order_than_their_shots(kind: Kind) -> None:
    comes = {**soon(), 12: 31.0, 13: 30.6, 14: 30.2, 15: 29.8}
    comes = {shot: max(at, EVERY_S * shot + 0.1) for shot, at in comes.items()}
    assert flown(kind, comes)[1] == right(kind)


@SURE
@pytest.mark.parametrize("after", [1.0, 10.0, 600.0])
@pytest.mark.parametrize("shuffled", [False, True])
def test_a_camera_that_writes_everything_after_landing(kind: Kind, after: float, shuffled: bool) -> None:
    order = list(range(COUNT))
    random.Random(5).shuffle(order) if shuffled else None
    comes = {shot: EVERY_S * COUNT + after + 0.1 * place for place, shot in enumerate(order)}
    assert flown(kind, comes)[1] == right(kind)


def test_files_after_landing_with_the_same_gap_as_the_shots() -> None:
    def leap(shot: int) -> int:
        return 5 * (shot > 8)

    gappy = Kind(
        How.SEQUENCE, lambda shot: f"IMG_{7000 + shot + leap(shot)}.JPG", count=lambda shot: 300 + shot + leap(shot)
    )
    assert flown(gappy, AFTER_LANDING)[1] == right(gappy)


def test_files_after_landing_with_another_gap_than_the_shots_are_not_guessed_about() -> None:
    gappy = Kind(How.SEQUENCE, lambda shot: f"IMG_{7000 + shot + 5 * (shot > 8)}.JPG")
    assert flown(gappy, AFTER_LANDING)[1] == {}


def test_a_gap_in_the_numbers_of_files_after_landing_tells_which_is_missing() -> None:
    pairing, ended = flown(COUNTERS, {shot: at for shot, at in AFTER_LANDING.items() if shot not in (7, 8)})
    assert ended == right(COUNTERS, [shot for shot in range(COUNT) if shot not in (7, 8)])
    assert (pairing.accounts().missing, pairing.accounts().orphans) == (2, 0)


@pytest.mark.parametrize("without", [0, 19])
def test_files_after_landing_that_fit_two_ways_are_paired_in_one_and_it_is_said(without: int) -> None:
    """Whether the first or the last was lost, nothing tells: the other way is a shift of all."""
    pairing, ended = flown(COUNTERS, {shot: at for shot, at in AFTER_LANDING.items() if shot != without})
    first = min(ended)
    assert [*ended.values()] == [COUNTERS.name(shot) for shot in range(COUNT) if shot != without]
    assert pairing.doubts.pairs >= COUNT - 2
    assert first in (0, 1)
    assert (1 if first == 0 else -1) in pairing.doubts.shifts


def test_a_name_leaves_no_gap_after_landing() -> None:
    comes = {shot: at for shot, at in AFTER_LANDING.items() if shot not in (0, 7)}
    assert flown(NAMES, comes)[1] == right(NAMES, [shot for shot in range(COUNT) if shot not in (0, 7)])


@SURE
def test_copied_files_whose_times_are_gone(kind: Kind) -> None:
    """Ten come in flight, the card is copied later: all at once, in the order of a directory."""
    comes = {**soon(), **dict.fromkeys(range(10, COUNT), 300.0)}
    assert flown(kind, comes)[1] == right(kind)


def test_without_names_and_counters_files_after_landing_stay_orphans() -> None:
    pairing, ended = flown(TIMES, dict.fromkeys(range(COUNT), 700.0))
    assert ended == {}
    assert (pairing.accounts().missing, pairing.accounts().orphans) == (COUNT, COUNT)


def test_the_better_reason_wins() -> None:
    """By its time file 5 is shot 5's; by its number shot 6's; by its name shot 7's."""
    kind = Kind(How.NAME, COUNTERS.name, lambda shot: "IMG_7006.JPG" if shot == 7 else "")
    comes = {shot: at for shot, at in soon().items() if shot < 5}
    _, ended = flown(kind, {**comes, 6: 10.7})
    assert ended == {**right(kind, range(5)), 7: "IMG_7006.JPG"}
    _, ended = flown(COUNTERS, {**comes, 6: 10.7})
    assert ended[6] == "IMG_7006.JPG"
    _, ended = flown(TIMES, {**comes, 6: 10.7})
    assert ended[5] == TIMES.name(6)


def test_where_names_are_right_a_stranger_is_not_given_to_a_shot_that_names_another() -> None:
    pairing, ended = flown(NAMES, soon(6), {"zz.png": 12.9})
    assert ended == right(NAMES, [shot for shot in range(COUNT) if shot != 6])
    assert (pairing.accounts().missing, pairing.accounts().orphans) == (1, 1)
