"""Whom a link follows: the first aircraft, until it is gone or the operator chooses another; nobody's triggers are lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import pytest

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import MOST_AIRCRAFT, VehicleChoice
from gcs_mosaic.messages import Notice, TriggerEvent
from tests.mavlink.mavlink_peer import heartbeat, received, trigger

SETTINGS = LinkSettings(decide_after_s=3.0, release_s=30.0)
CAMERA_KIND, NO_AUTOPILOT = 30, 8


class Link:
    """A listener, and all that came out of it."""

    def __init__(self, settings: LinkSettings = SETTINGS) -> None:
        self.choice = VehicleChoice(settings)
        self.listener = Listener(parse_address("udp:14550"), settings, self.choice, 0.0, lambda: 1.75e9)
        self.came: list[object] = []

    def heartbeats(self, system: int, times: Iterable[float], **kind: int) -> None:
        for now in times:
            self.came += self.listener.hear(received(heartbeat(**kind), system=system), now)
            self.came += self.listener.tick(now)

    def trigger(self, system: int, now: float, seq: int = 1) -> None:
        self.came += self.listener.hear(received(trigger(seq), system=system), now)
        self.came += self.listener.tick(now)

    @property
    def events(self) -> Iterator[tuple[int, float]]:
        return ((item.vehicle, item.received) for item in self.came if isinstance(item, TriggerEvent))

    @property
    def texts(self) -> list[str]:
        return [item.text for item in self.came if isinstance(item, Notice)]


def test_a_forged_trigger_before_any_heartbeat_does_not_decide() -> None:
    link = Link()
    link.trigger(66, 0.0)
    link.trigger(1, 0.5)
    assert list(link.events) == []
    link.heartbeats(1, [1.0])
    assert list(link.events) == [(1, 0.5)]
    assert link.choice.followed == 1


def test_triggers_before_a_heartbeat_are_let_in_with_their_own_times() -> None:
    link = Link()
    for k in range(5):
        link.trigger(1, k / 10, k)
    assert list(link.events) == []
    link.heartbeats(1, [1.0])
    assert list(link.events) == [(1, k / 10) for k in range(5)]


def test_a_camera_without_an_autopilot_is_followed_after_a_while() -> None:
    link = Link()
    link.heartbeats(42, [0.0], kind=CAMERA_KIND, autopilot=NO_AUTOPILOT)
    link.trigger(42, 1.0)
    link.heartbeats(42, [2.0, 3.0], kind=CAMERA_KIND, autopilot=NO_AUTOPILOT)
    assert list(link.events) == []
    link.came += link.listener.tick(4.1)
    assert list(link.events) == [(42, 1.0)]
    assert any("though no autopilot of it is heard" in text for text in link.texts)


def test_a_forger_of_one_message_gives_way_to_the_aircraft_and_none_of_its_triggers_is_lost() -> None:
    link = Link()
    link.trigger(66, 0.0)
    link.heartbeats(1, [1.0, 2.0, 3.0, 3.5, 5.0])
    assert link.choice.followed == 66
    link.trigger(1, 6.0)
    assert (link.choice.followed, list(link.events)) == (1, [(66, 0.0), (1, 6.0)])


def test_a_forger_with_one_heartbeat_gives_way_when_it_has_been_silent_for_long() -> None:
    link = Link()
    link.heartbeats(66, [0.0])
    link.trigger(66, 0.1)
    for now in range(1, 40):
        link.heartbeats(1, [now])
        link.trigger(1, now + 0.5, now)
    assert list(link.events) == [(66, 0.1), *((1, now + 0.5) for now in range(1, 40))]
    assert any("system 66 has been silent for 30 s and system 1 triggers a camera" in text for text in link.texts)


def test_a_gap_behind_a_hill_is_no_release_while_no_other_triggers() -> None:
    link = Link()
    link.heartbeats(1, [0.0])
    link.trigger(1, 0.5)
    link.heartbeats(2, range(1, 200))
    link.trigger(1, 200.0)
    assert list(link.events) == [(1, 0.5), (1, 200.0)]


def test_a_system_id_that_changes_in_flight_is_followed_on() -> None:
    link = Link()
    for now in range(60):
        system = 1 if now < 20 else 7
        link.heartbeats(system, [now])
        link.trigger(system, now + 0.5, now)
    assert [moment for _, moment in link.events] == [now + 0.5 for now in range(60)]


def test_a_program_that_stood_still_releases_nobody() -> None:
    """What the kernel held is read oldest first: that of the followed aircraft may yet come."""
    link = Link()
    link.heartbeats(1, [0.0])
    link.trigger(1, 0.5)
    link.trigger(2, 1.0)
    link.came += link.listener.tick(60.0)
    assert link.choice.followed == 1


def test_the_operators_choice_counts_and_its_triggers_of_the_last_minute_are_let_in() -> None:
    link = Link()
    link.heartbeats(1, [0.0])
    link.heartbeats(2, [0.0])
    link.trigger(1, 0.5)
    for now in (1.0, 50.0, 80.0):
        link.heartbeats(1, range(int(now), int(now) + 25))
        link.trigger(2, now + 24.0)
    link.heartbeats(1, [120.0])
    assert list(link.events) == [(1, 0.5)]
    assert link.choice.choose(2)
    link.came += link.listener.tick(124.0)
    assert list(link.events) == [(1, 0.5), (2, 74.0), (2, 104.0)]
    for now in range(125, 200):
        link.trigger(1, now, now)
    assert link.choice.followed == 2, "what was asked for is not released"


def test_the_choice_of_a_system_that_is_not_heard_changes_nothing() -> None:
    link = Link()
    link.trigger(1, 0.5)
    assert not link.choice.choose(9)
    assert link.choice.systems() == [1]


def test_with_two_aircraft_it_is_said_how_to_choose() -> None:
    link = Link()
    link.heartbeats(1, [0.0])
    link.heartbeats(2, [0.0])
    link.trigger(1, 0.5)
    for now in range(1, 9):
        link.trigger(2, now, now)
    assert [text for text in link.texts if "gcs-mosaic vehicle ID follows another" in text]
    assert len([text for text in link.texts if "gcs-mosaic vehicle 2 follows it instead" in text]) == 1


def test_a_forger_of_all_system_ids_is_not_named_each_time() -> None:
    link = Link()
    link.heartbeats(1, [0.0])
    link.trigger(1, 0.5)
    for k in range(2000):
        link.trigger(2 + k % 250, 1.0 + k / 1000, k)
    assert len([text for text in link.texts if "left out" in text]) == 9
    assert link.choice.followed == 1


def test_two_links_agree_and_each_lets_in_its_own() -> None:
    one, other = Link(), Link()
    other.listener = Listener(parse_address("udp:14551"), SETTINGS, one.choice, 0.0, lambda: 1.75e9)
    other.trigger(1, 0.1)
    one.heartbeats(1, [0.5])
    assert (list(one.events), list(other.events)) == ([], [])
    other.came += other.listener.tick(0.6)
    assert list(other.events) == [(1, 0.1)]


def test_what_is_held_at_the_end_is_let_in() -> None:
    link = Link()
    link.trigger(1, 0.5)
    link.came += link.listener.farewell(1.0)
    assert list(link.events) == [(1, 0.5)]


@pytest.mark.parametrize("settings", [LinkSettings(vehicle=2), LinkSettings(vehicle=2, decide_after_s=0)])
def test_an_aircraft_that_was_asked_for_at_the_start_needs_no_heartbeat(settings: LinkSettings) -> None:
    link = Link(settings)
    link.trigger(1, 0.0)
    link.trigger(2, 0.1)
    assert list(link.events) == [(2, 0.1)]


def test_of_several_aircraft_all_triggers_count_at_once_and_those_of_others_are_left_out() -> None:
    link = Link(LinkSettings(vehicles=(1, 2)))
    for system in (2, 3, 1):
        link.trigger(system, float(system))
    assert list(link.events) == [(2, 2.0), (1, 1.0)]
    assert link.choice.followed is None
    assert not link.choice.choose(2)
    left_out = [text for text in link.texts if "is left out" in text]
    assert left_out == [
        "system 3 triggers a camera too and is left out, because this flight is of systems 1, 2: "
        "start with --vehicle 3 too to count it"
    ]


def test_all_means_as_many_as_fly_and_not_as_many_as_can_be_forged() -> None:
    link = Link(LinkSettings(vehicles=("all",)))
    for system in range(1, 200):
        link.trigger(system, 1.0)
    assert [system for system, _ in link.events] == list(range(1, MOST_AIRCRAFT + 1))
    assert link.choice.counted == tuple(range(1, MOST_AIRCRAFT + 1))


def test_ids_without_an_autopilot_take_no_place_of_an_aircraft_that_has_one() -> None:
    link = Link(LinkSettings(vehicles=("all",)))
    for system in range(100, 100 + MOST_AIRCRAFT):
        link.trigger(system, 0.0)
    link.heartbeats(1, [1.0])
    link.trigger(1, 2.0)
    assert list(link.events)[-1] == (1, 2.0)
    assert len(link.choice.counted) == MOST_AIRCRAFT
    link.trigger(200, 3.0)
    assert 200 not in link.choice.counted
