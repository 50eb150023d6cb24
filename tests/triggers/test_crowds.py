"""Forged triggers of 39 components, 300 before each of ten shots, in the aircraft's name: seven of ten lost their frame once.

Gate, shots and pairing together, as in the program; nobody knows of the camera before.
"""

from __future__ import annotations

import random

import pytest

from gcs_mosaic.mavlink.flood import FloodGate, Trust
from gcs_mosaic.messages import Frame, Source, TriggerEvent
from gcs_mosaic.triggers import Matched, Outcome, Pairing, Unmatched
from gcs_mosaic.triggers.shots import Better, New, Shots, ShotSettings
from tests.factories import frame, trigger_event

SHOTS, FORGED, COMPONENTS, DELAY_S = 10, 300, 39, 0.5
CAMERA, FEEDBACK = Source.IMAGE_CAPTURED_BY_CAMERA, Source.CAMERA_FEEDBACK


class Attacked:
    """The way of messages from the link to their pairs."""

    def __init__(self) -> None:
        self.trust, self.pairing, self.rows = Trust(), Pairing(), 0
        self.gate = FloodGate(20.0, 200, self.trust)
        self.shots = Shots(ShotSettings(), lambda: self.trust.sources)
        self.pairs: dict[int, str] = {}
        self.real: dict[int, int] = {}

    def hear(self, event: TriggerEvent, now: float) -> None:
        for one in self.gate.ask(event)[1]:
            self.admit(one, now)

    def admit(self, event: TriggerEvent, now: float) -> None:
        message = self.shots.hear(event)
        self.rows += 1
        number = message.number if isinstance(message.verdict, New) else message.verdict.of
        if isinstance(message.verdict, New):
            self.note(self.pairing.event(number, event, message.verdict.moment, now))
        elif isinstance(message.verdict, Better):
            self.note(self.pairing.improve(number, event, now))
        else:
            self.pairing.duplicate(number, event)
        if event.component == 1 and event.sequence is not None:
            self.real[event.sequence] = number

    def take(self, found: Frame, now: float) -> None:
        self.note(self.pairing.frame(found, now))
        self.trust.sources = self.pairing.credible()

    def note(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            if isinstance(outcome, Matched):
                self.pairs[outcome.event_id] = outcome.frame.name
            elif isinstance(outcome, Unmatched):
                self.pairs.pop(outcome.event_id, None)


MORE = [(source, *times) for source in (CAMERA, FEEDBACK) for times in ((2.0, 0.3), (5.0, 0.3), (0.5, 0.5), (2.0, 2.0))]


@pytest.mark.parametrize(
    ("source", "every", "within"),
    [(FEEDBACK, 2.0, 0.3), *(pytest.param(*one, marks=pytest.mark.long) for one in MORE)],
)
def test_a_crowd_of_forgers_costs_two_shots_at_most_and_some_hundred_rows(
    source: Source, every: float, within: float
) -> None:
    dice, flight, coming = random.Random(1), Attacked(), list[tuple[float, TriggerEvent | Frame]]()
    for shot in range(SHOTS):
        at = 10 + every * shot
        for k in range(FORGED):
            when = at - dice.random() * within - 0.001
            fields = {"component": 2 + k % COMPONENTS, "source_time": when + dice.random(), "clock": "boot"}
            coming.append((when, trigger_event(dice.randrange(65536), when, source=CAMERA, **fields)))
        coming.append((at, trigger_event(shot, at, source=source, source_time=at + 50, clock="boot", sender="camera")))
        coming.append((at + DELAY_S, frame(f"DSC{500 + shot:05d}.jpg", at + DELAY_S)))
    for now, what in sorted(coming, key=lambda one: one[0]):
        flight.note(list(flight.pairing.tick(now)))
        for held in list(flight.gate.ripe(now)):
            flight.admit(held, now)
        flight.take(what, now) if isinstance(what, Frame) else flight.hear(what, now)
    flight.note(flight.pairing.close())
    own = [flight.pairs.get(flight.real.get(shot, -1)) == f"DSC{500 + shot:05d}.jpg" for shot in range(SHOTS)]
    assert sum(own) >= SHOTS - 2
    assert flight.rows <= 700
