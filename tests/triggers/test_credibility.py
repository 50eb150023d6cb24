"""Forged events among real ones: the source whose shots agree with the files comes first."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.messages import CaptureResult, Frame, Source, TriggerEvent
from gcs_mosaic.triggers import Matched, Outcome, Pairing, Unmatched

REAL, FORGED = "10.0.0.1:1", "10.0.0.66:9"


def event(moment: float, sequence: int, sender: str = REAL, component: int = 1) -> TriggerEvent:
    return TriggerEvent(
        vehicle=1, component=component, camera=0, source=Source.CAMERA_FEEDBACK, sequence=sequence, received=moment,
        source_time=None, clock="none", utc=None, result=CaptureResult.TAKEN, file_hint=None, position=None,
        sender=sender,
    )  # fmt: skip


def frame(number: int, received: float) -> Frame:
    name = f"DSC{number:05d}.jpg"
    return Frame(name=name, path=Path(name), content_hash=name, size=1, received=received, modified=received)


class Flight:
    """Real shots at two a second, whose files come 0.3 s later, and whatever is forged; events in order of time."""

    def __init__(self, shots: int, forged: list[TriggerEvent]) -> None:
        self.pairing = Pairing()
        self.own: dict[int, str] = {}  # by event id
        real = [event(0.5 * k, k) for k in range(1, shots + 1)]
        files = [frame(500 + k, 0.5 * k + 0.3) for k in range(1, shots + 1)]
        happenings: list[TriggerEvent | Frame] = [*real, *forged, *files]
        happenings.sort(key=lambda one: one.received)
        self.real: dict[int, str] = {}
        for number, one in enumerate(happenings):
            if isinstance(one, Frame):
                self.note(self.pairing.frame(one, one.received))
            else:
                if one.sender == REAL:
                    self.real[number] = f"DSC{500 + (one.sequence or 0):05d}.jpg"
                self.note(self.pairing.event(number, one, one.received, one.received))
        self.note(self.pairing.close())

    def note(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            if isinstance(outcome, Matched):
                self.own[outcome.event_id] = outcome.frame.name
            elif isinstance(outcome, Unmatched):
                self.own.pop(outcome.event_id, None)

    @property
    def right(self) -> int:
        return sum(self.own.get(number) == name for number, name in self.real.items())


def counters_ahead(count: int, rate: float) -> list[TriggerEvent]:
    return [event(0.6 + k / rate, k, FORGED) for k in range(1, count + 1)]


def sparse(components: int) -> list[TriggerEvent]:
    return [event(0.1 + k / 100, 7000 + k, FORGED, 2 + k % components) for k in range(2 * components)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("forged", "least"),
    [([], 40), (counters_ahead(39, 17.0), 40), (counters_ahead(170, 17.0), 40), (sparse(20), 40)],
    ids=["none", "39 ahead", "17 a second throughout", "20 that speak first"],
)
def test_forged_events_do_not_drag_real_shots_away(forged: list[TriggerEvent], least: int) -> None:
    flight = Flight(40, forged)
    assert flight.right >= least


def test_the_real_source_is_known_and_the_forged_one_is_not() -> None:
    credible = Flight(20, counters_ahead(39, 17.0)).pairing.credible()
    assert {teller.sender for teller in credible} == {REAL}


@pytest.mark.long
def test_two_cameras_of_one_aircraft_are_both_believed() -> None:
    """The files of the second come from a shot 0.25 s later."""
    pairing, outcomes = Pairing(), list[Outcome]()
    for k in range(40):
        for component, moment in ((100, 0.5 * k), (101, 0.5 * k + 0.25)):
            told = replace(event(moment, k, component=component), camera=component)
            outcomes += pairing.event(2 * k + component - 100, told, moment, moment)
            outcomes += pairing.frame(frame(1000 * component + k, moment + 0.1), moment + 0.1)
    assert len([outcome for outcome in outcomes if isinstance(outcome, Matched)]) == 80
    assert {teller.component for teller in pairing.credible()} == {100, 101}


@pytest.mark.long
def test_a_camera_whose_files_go_elsewhere_harms_nobody() -> None:
    flight = Flight(40, [event(0.5 * k + 0.1, k, "10.0.0.1:2", 101) for k in range(1, 41)])
    assert flight.right == 40


def test_a_source_under_another_address_goes_on_where_the_first_ended() -> None:
    """The forwarder was started anew, and the autopilot's counters with it."""
    later = [event(0.5 * k, k - 20, "10.0.0.1:7") for k in range(21, 41)]
    flight, pairing = Flight(0, []), Pairing()
    for k, shot in enumerate([*(event(0.5 * k, k) for k in range(1, 21)), *later], 1):
        flight.real[k] = f"DSC{500 + k:05d}.jpg"
        flight.note(pairing.event(k, shot, shot.received, shot.received))
        flight.note(pairing.frame(frame(500 + k, shot.received + 0.3), shot.received + 0.3))
    assert flight.right == 40


def test_judging_a_crowd_costs_little() -> None:
    pairing = Pairing()
    for k in range(600):
        pairing.event(k, event(k / 50, k, FORGED, 2 + k % 30), k / 50, k / 50)
    start = time.perf_counter()
    for k in range(10):
        pairing.frame(frame(k, 12 + k), 12 + k)
    assert (time.perf_counter() - start) / 10 < 1.0


def names_ahead(count: int, components: int) -> list[TriggerEvent]:
    """Names of files that are still to come, told at once."""
    return [
        replace(event(0.1 + k / 100, 9000 + k, FORGED, 2 + k % components), file_hint=f"DSC{500 + k:05d}.jpg")
        for k in range(1, count + 1)
    ]


@pytest.mark.long
@pytest.mark.parametrize("components", [1, 40])
def test_forged_names_do_not_drag_real_shots_away(components: int) -> None:
    assert Flight(40, names_ahead(40, components)).right >= 38


def failures(count: int) -> list[tuple[int, TriggerEvent]]:
    """For each real shot a message that it brought no picture, by somebody else."""
    return [(k, replace(event(0.5 * k + 0.1, k, FORGED, 66), result=CaptureResult.FAILED)) for k in range(1, count + 1)]


def flown_with(forged: list[tuple[int, TriggerEvent]], count: int = 40) -> dict[int, str]:
    """Real shots, told to be the same as forged messages; by number of the shot the file that it ended with."""
    pairing, ended = Pairing(), dict[int, str]()
    happenings: list[tuple[float, int, TriggerEvent | Frame]] = [
        (0.5 * k, k, event(0.5 * k, k)) for k in range(1, count + 1)
    ]
    happenings += [(one.received, k, one) for k, one in forged]
    happenings += [(0.5 * k + 0.3, k, frame(500 + k, 0.5 * k + 0.3)) for k in range(1, count + 1)]
    for now, k, one in sorted(happenings, key=lambda happening: happening[:2]):
        if isinstance(one, Frame):
            outcomes = pairing.frame(one, now)
        elif one.sender == REAL:
            outcomes = pairing.event(k, one, now, now)
        else:
            outcomes = pairing.improve(k, one, now)
        for outcome in outcomes:
            if isinstance(outcome, Matched):
                ended[outcome.event_id] = outcome.frame.name
            elif isinstance(outcome, Unmatched):
                ended.pop(outcome.event_id, None)
    return ended


def right_of(ended: dict[int, str]) -> int:
    return sum(name == f"DSC{500 + k:05d}.jpg" for k, name in ended.items())


def test_forged_failures_of_real_shots_are_not_believed_once_the_real_source_is_known() -> None:
    assert right_of(flown_with(failures(40))) >= 35


def test_a_camera_that_fails_is_believed() -> None:
    """It tells all shots, the autopilot too; its seventh brings no picture."""
    told = [
        (k, replace(event(0.5 * k + 0.05, k, "10.0.0.1:2", 100), source=Source.IMAGE_CAPTURED_BY_CAMERA))
        for k in range(1, 21)
    ]
    told[6] = (7, replace(told[6][1], result=CaptureResult.FAILED))
    assert 7 not in flown_with(told, 20)


def test_a_flight_whose_files_come_after_it_is_still_named() -> None:
    """The camera names them in flight; they are brought in an hour later, in any order."""
    pairing = Pairing()
    for k in range(30):
        pairing.event(k, replace(event(2.0 * k, k), file_hint=f"DSC{500 + k:05d}.jpg"), 2.0 * k, 2.0 * k)
    matched = [one for k in reversed(range(30)) for one in pairing.frame(frame(500 + k, 3600.0 - k), 3600.0 - k)]
    pairs = {one.event_id: one.frame.name for one in matched if isinstance(one, Matched)}
    assert pairs == {k: f"DSC{500 + k:05d}.jpg" for k in range(30)}
