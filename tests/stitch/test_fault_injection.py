"""A frame is a transaction: whatever raises while it is placed, everything is as before, and the flight goes on.

Any call at any depth is made to raise, at random but always the same ones; all that can be reached is compared byte for byte
with a flight that met no fault.
"""

import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest
from faults import Event, Fault, chosen, counted, raising
from whole_state import digest

from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjusted
from gcs_mosaic.stitch.bundle.schedule import UpkeepSettings
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.candidates import SearchSettings
from gcs_mosaic.stitch.mapping.incremental_mapper import Assembly
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.registration.outcome import Registration
from sitl.path import Plan, fly
from tests.benchmarks import flight_of_points

pytestmark = pytest.mark.long


SETTINGS = StitchSettings(
    search=SearchSettings(neighbours=3, first_tries=2),
    upkeep=UpkeepSettings(background_from=6, meanwhile=4),
)
Flight = list[tuple[str, Features]]

SEEN = 120  # marks in a frame
PLAN = Plan(frames=14, height=flight_of_points.HEIGHT, forward=0.6, strangers=2, tilt=0.1)
FAULTS_PER_FRAME = 10
JUDGED = ("stitch/mapping/islands.py:Bridges._evidence", "call")  # a bridge is kept already
NEXT = ("stitch/bundle/schedule.py:Upkeep._adjust", "call")
DONE = ("stitch/mapping/incremental_mapper.py:Assembly.take_in", "return")  # all is done, and not yet settled


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A line, two strangers, a second line that founds an island, and the way back that joins them."""
    states = fly("lost", flight_of_points.LENS, PLAN)
    found = flight_of_points.features_of_states(states, seed=1, seen=SEEN)
    return [(f"{k:02}", features) for k, features in enumerate(found)]


class HelpingHand:
    """A worker that adjusts when its answer is wanted."""

    def begin(self, task: IslandTask) -> None:
        self._task = task

    def is_ready(self) -> bool:
        return True

    def result(self) -> AdjustedIsland:
        return adjusted(self._task)


def new_mosaic() -> Mosaic:
    return Mosaic(SETTINGS, HelpingHand(), punctual=True)


@dataclass
class Step:
    """A frame of a flight without faults: what happened while it was placed, and while the map was adjusted after it."""

    outcome: object
    before: str
    placed: str
    taken_in: str  # with the result of an adjustment, if there was one, and before the next one was begun
    adjusted: str
    placing: Counter[Event]
    adjusting: Counter[Event]
    islands: int = field(default=0)


@pytest.fixture(scope="module")
def undisturbed(flight: Flight) -> list[Step]:
    mosaic, twin = new_mosaic(), new_mosaic()
    steps: list[Step] = []
    for name, features in flight:
        before = digest(mosaic)
        with counted() as placing:
            outcome = mosaic.place(features, name)
        placed = digest(mosaic)
        with counted() as adjusting:
            mosaic.adjust()
        taken_in = placed
        twin.place(features, name)
        if NEXT in adjusting:  # a step of its own, after that which takes a result in
            with pytest.raises(Fault), raising(NEXT, 1):
                twin.adjust()
            taken_in = digest(twin)
        twin.adjust()
        islands = len(mosaic.frame_counts())
        steps.append(Step(outcome, before, placed, taken_in, digest(mosaic), placing, adjusting, islands))
    return steps


@pytest.mark.thorough
def test_the_flight_has_all_that_can_happen_to_a_frame(undisturbed: list[Step]) -> None:
    """Frames placed and waiting, those that find their place by another's, islands founded and joined, tasks handed over."""
    kinds = [type(step.outcome).__name__ for step in undisturbed]
    assert {"Placement", "Waiting"} == set(kinds)
    assert [step.islands for step in undisturbed].count(2) > 2
    assert undisturbed[-1].islands == 1
    called = {event[0].rpartition(":")[2] for step in undisturbed for event in (*step.placing, *step.adjusting)}
    assert {
        *("Assembly._found_with_waiting", "Bridges.add", "Bridges.join", "WaitingFrames.remove"),
        *("Upkeep._begin", "Upkeep._take_in", "take_in", "_carry_along", "note_relief"),
    } <= called


@pytest.mark.thorough
def test_whatever_raises_while_a_frame_is_placed_nothing_has_changed(flight: Flight, undisturbed: list[Step]) -> None:
    """Each frame comes again and again, and every time something raises; then it comes once more."""
    rng, mosaic = random.Random(1), new_mosaic()
    for (name, features), step in zip(flight, undisturbed, strict=True):
        for event, at in chosen(step.placing, FAULTS_PER_FRAME, rng, but="Mosaic.place"):
            with pytest.raises(Fault), raising(event, at):
                mosaic.place(features, name)
            assert digest(mosaic) == step.before, f"{name}: {event}, {at}"
        assert mosaic.place(features, name) == step.outcome
        assert digest(mosaic) == step.placed
        mosaic.adjust()
        assert digest(mosaic) == step.adjusted


@pytest.mark.thorough
def test_whatever_raises_while_islands_are_adjusted_each_is_adjusted_or_as_it_was(
    flight: Flight, undisturbed: list[Step]
) -> None:
    rng, mosaic = random.Random(2), new_mosaic()
    for (name, features), step in zip(flight, undisturbed, strict=True):
        mosaic.place(features, name)
        (event, at), *_ = chosen(step.adjusting, 1, rng, but="Mosaic.adjust")
        with pytest.raises(Fault), raising(event, at):
            mosaic.adjust()
        if step.islands == 1:
            assert digest(mosaic) in (step.placed, step.taken_in, step.adjusted), f"{name}: {event}, {at}"
        mosaic.adjust()
        assert digest(mosaic) == step.adjusted, f"{name}: {event}, {at}"


@pytest.mark.thorough
@pytest.mark.parametrize(("missing", "event"), [(8, DONE), (15, JUDGED)])
def test_the_next_frames_are_placed_as_if_it_had_never_come(flight: Flight, missing: int, event: Event) -> None:
    """One that founds an island and one that joins two are lost, by a fault late in the work on them."""
    with_fault, without = new_mosaic(), new_mosaic()
    for k, (name, features) in enumerate(flight):
        if k == missing:
            for kind in (Fault, MemoryError, KeyboardInterrupt):
                with pytest.raises(kind), raising(event, 1, kind):
                    with_fault.place(features, name)
            continue
        assert with_fault.place(features, name) == without.place(features, name)
        for mosaic in (with_fault, without):
            mosaic.adjust()
    assert digest(with_fault) == digest(without)


def test_what_is_kept_elsewhere_is_noticed(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    """This is what such a fault of the program would look like."""
    take_in = Assembly.take_in

    def counting(self: Assembly, frame: int, compared: Mapping[int, Registration | None]) -> bool:
        vars(self)["seen"] = vars(self).get("seen", 0) + 1
        return take_in(self, frame, compared)

    monkeypatch.setattr(Assembly, "take_in", counting)
    mosaic = new_mosaic()
    before = digest(mosaic)
    with pytest.raises(Fault), raising(("stitch/mapping/incremental_mapper.py:Assembly._found_island", "call"), 1):
        mosaic.place(flight[0][1], "0")
    assert digest(mosaic) != before
