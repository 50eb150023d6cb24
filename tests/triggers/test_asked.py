"""Frames that were taken from a live stream for an event."""

from __future__ import annotations

from gcs_mosaic.messages import Frame, TriggerEvent
from gcs_mosaic.triggers import How, Matched, Orphan, Pairing
from tests.factories import frame, trigger_event


def shot(at: float) -> TriggerEvent:
    return trigger_event(received=at, file_hint=f"IMG_{at:.0f}.JPG")  # of the camera's own card


def taken(at: float) -> Frame:
    return frame(f"stream/{at}.jpg", at)


def told(count: int) -> Pairing:
    pairing = Pairing()
    for event_id in range(count):
        pairing.event(event_id, shot(0.3 * event_id), 0.3 * event_id, now=0.3 * event_id)
    return pairing


def test_a_frame_belongs_to_the_event_that_asked_for_it_whatever_the_times_say() -> None:
    pairing = told(4)
    for event_id in (2, 0, 3):
        came = taken(2.0 + event_id)
        (outcome,) = pairing.frame(came, came.received, fresh=False, asked_by=event_id)
        assert outcome == Matched(event_id, shot(0.3 * event_id), came, How.ASKED)
    accounts = pairing.accounts()
    assert (accounts.matched, accounts.pending, accounts.orphans) == (3, 1, 0)


def test_a_frame_that_nobody_asked_for_takes_no_event() -> None:
    pairing = told(2)
    assert pairing.frame(taken(1.0), 1.0, fresh=False) == [Orphan(taken(1.0))]
    assert pairing.frame(taken(2.0), 2.0, fresh=False, asked_by=99) == [Orphan(taken(2.0))]
    assert pairing.accounts().pending == 2


def test_an_event_that_was_missing_is_matched_by_the_frame_it_asked_for() -> None:
    pairing = told(1)
    pairing.tick(1000.0)
    pairing.frame(taken(1001.0), 1001.0, fresh=False, asked_by=0)
    assert (pairing.accounts().matched, pairing.accounts().missing) == (1, 0)
