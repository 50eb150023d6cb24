from __future__ import annotations

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.parser import dialect
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import LinkReport, Notice, Refusals, TriggerEvent
from tests.mavlink.mavlink_peer import heartbeat, received, trigger

SETTINGS = LinkSettings(decide_after_s=0, silent_after_s=10, ground_station_after_s=20)


def listener(choice: VehicleChoice | None = None, address: str = "udp:14550") -> Listener:
    return Listener(
        parse_address(address), SETTINGS, choice or VehicleChoice(SETTINGS), started=0.0, utc_of_zero=lambda: 1.75e9
    )


def texts(items: object) -> list[str]:
    return [item.text for item in items if isinstance(item, Notice)]  # type: ignore[attr-defined]


def report(ours: Listener, now: float) -> LinkReport:
    return next(item for item in ours.tick(now) if isinstance(item, LinkReport))


def test_the_first_heartbeat_of_a_vehicle_is_said_once() -> None:
    ours = listener()
    assert "system 7 (PX4, quadrotor)" in texts(ours.hear(received(heartbeat(), system=7), 1.0))[0]
    assert texts(ours.hear(received(heartbeat(), system=7), 2.0)) == []


def test_silence_is_said_once_and_so_is_its_end() -> None:
    ours = listener()
    assert texts(ours.tick(9.0)) == []
    assert texts(ours.tick(10.5)) == ["nothing was heard on udpin:0.0.0.0:14550 since it was opened, 10 s ago"]
    assert texts(ours.tick(30.0)) == []
    assert "for the first time, 31 s after it was opened" in texts(ours.hear(received(trigger(1)), 31.0))[0]
    assert texts(ours.tick(32.0)) == []
    assert "is silent: nothing for 10 s" in texts(ours.tick(42.0))[0]
    assert "again after 20 s" in texts(ours.hear(received(trigger(2)), 51.0))[0]


def test_where_all_is_refused_it_is_not_said_that_nothing_was_heard() -> None:
    ours = listener()
    assert "forged packets are refused" in texts(ours.tick(1.0, refused=Refusals(forged=3)))[0]
    (text,) = texts(ours.tick(10.5, refused=Refusals(forged=9)))
    assert text == "nothing that is signed with the key was heard on udpin:0.0.0.0:14550 since it was opened, 10 s ago"


def test_silences_are_counted() -> None:
    ours = listener()
    for start in (20.0, 40.0, 60.0):
        list(ours.tick(start))
        list(ours.hear(received(trigger(1)), start + 1))
    list(ours.tick(80.0))
    assert report(ours, 82.0).silences == 4


def test_a_forger_with_many_names_does_not_fill_the_report() -> None:
    ours = listener(VehicleChoice(LinkSettings(vehicle=1)))
    for system in range(2, 255):
        for seq in range(1 + (system == 77)):
            list(ours.hear(received(trigger(seq), system=system), 1.0))
    assert report(ours, 2.0).others[0] == (77, 2)
    assert len(report(listener(), 2.0).others) == 0
    assert len(ours._report(True, Refusals(), 0).others) == 8


def test_a_trigger_is_dated_by_the_vehicles_own_clocks() -> None:
    ours = listener()
    list(ours.hear(received(dialect.MAVLink_system_time_message(1_750_000_100_000_000, 100_000)), 5.0))
    event = list(ours.hear(received(trigger(1, time_usec=102_500_000)), 8.0))[-1]
    assert isinstance(event, TriggerEvent)
    assert event.utc == 1_750_000_102.5


def test_a_missing_ground_station_is_said_with_advice() -> None:
    ours = listener()
    list(ours.hear(received(heartbeat()), 1.0))
    assert texts(ours.tick(9.0)) == []
    list(ours.hear(received(heartbeat()), 21.0))
    (notice,) = [item for item in ours.tick(22.0) if isinstance(item, Notice)]
    assert (notice.level, "14445" in notice.text) == ("warning", True)
    assert "is heard" in texts(ours.hear(received(heartbeat(kind=6), system=255), 23.0))[0]


def test_a_ground_station_that_is_heard_needs_no_word() -> None:
    ours = listener()
    list(ours.hear(received(heartbeat()), 1.0))
    assert texts(ours.hear(received(heartbeat(kind=6), system=255), 2.0)) == []
    list(ours.hear(received(heartbeat()), 59.0))
    assert texts(ours.tick(60.0)) == []


def test_a_ground_station_is_no_aircraft() -> None:
    ours = listener()
    list(ours.hear(received(heartbeat(kind=6), system=255), 2.0))
    heard = report(ours, 3.0)
    assert (heard.state, heard.hears_ground_station, heard.aircraft) == ("heard", True, ())


def test_on_a_forwarded_port_a_missing_ground_station_is_no_warning() -> None:
    ours = listener(address="udp:14445")
    list(ours.hear(received(heartbeat()), 19.0))
    list(ours.hear(received(heartbeat()), 39.0))
    assert [item.level for item in ours.tick(40.0) if isinstance(item, Notice)] == ["info"]


def test_where_only_this_machine_can_send_a_missing_ground_station_is_no_news() -> None:
    ours = listener(address="udp:127.0.0.1:14445")
    list(ours.hear(received(heartbeat()), 19.0))
    list(ours.hear(received(heartbeat()), 39.0))
    assert texts(ours.tick(40.0)) == []


def test_only_the_first_vehicle_that_triggers_is_followed() -> None:
    choice = VehicleChoice(SETTINGS)
    first, second = listener(choice), listener(choice)
    assert [type(item) for item in first.hear(received(trigger(1), system=3), 1.0)] == [Notice, TriggerEvent]
    assert "gcs-mosaic vehicle 4 follows it" in texts(second.hear(received(trigger(1), system=4), 2.0))[0]
    assert list(second.hear(received(trigger(2), system=4), 3.0)) == []
    assert choice.followed == 3
    assert report(second, 4.0).others == ((4, 2),)
    assert report(first, 4.0).others == ()


def test_the_vehicle_that_was_asked_for_is_followed() -> None:
    ours = listener(VehicleChoice(LinkSettings(vehicle=4)))
    assert "as asked" in texts(ours.hear(received(trigger(1), system=3), 1.0))[0]
    assert [type(item) for item in ours.hear(received(trigger(1), system=4), 2.0)] == [TriggerEvent]


def test_how_the_link_is_is_reported_when_it_changes_and_once_a_second() -> None:
    ours, told = listener(), list[tuple[float, str, float | None]]()
    for tenth in range(140):
        now = tenth / 10
        if tenth in range(10, 31):
            list(ours.hear(received(heartbeat()), now))
        told += [
            (now, item.state, item.last_heard_utc and item.last_heard_utc - 1.75e9)
            for item in ours.tick(now, working=tenth < 138)
            if isinstance(item, LinkReport)
        ]
    assert told == [
        (0.0, "listening", None), (1.0, "heard", 1.0), (2.0, "heard", 2.0), (3.0, "heard", 3.0),
        (13.2, "silent", 3.0), (13.8, "failed", 3.0),
    ]  # fmt: skip


def test_a_forger_with_many_names_is_greeted_in_nine_lines() -> None:
    """A forger that sent a heartbeat in the name of each of 254 systems brought 254 lines."""
    ours = listener()
    said = [text for system in range(1, 255) for text in texts(ours.hear(received(heartbeat(), system=system), 1.0))]
    assert sum("first heartbeat" in text for text in said) == 8
    assert "more than 8 systems are heard" in said[8]
    assert len(said) == 9
    assert texts(ours.hear(received(heartbeat(), system=200), 2.0)) == []


def test_who_the_operator_has_named_is_greeted_whoever_came_before() -> None:
    ours = listener(VehicleChoice(LinkSettings(vehicle=200)))
    for system in range(1, 100):
        list(ours.hear(received(heartbeat(), system=system), 1.0))
    assert "first heartbeat" in texts(ours.hear(received(heartbeat(), system=200), 2.0))[0]


def test_as_many_aircraft_as_count_are_greeted() -> None:
    choice = VehicleChoice(SETTINGS)
    choice.count("all")
    ours = listener(choice)
    said = [text for system in range(1, 17) for text in texts(ours.hear(received(heartbeat(), system=system), 1.0))]
    assert len(said) == 16


def test_a_choice_among_many_forged_systems_is_told_in_a_short_sentence() -> None:
    ours = listener()
    for system in range(1, 255):
        list(ours.hear(received(heartbeat(), system=system), 1.0))
    (said,) = texts(ours.hear(received(trigger(1), system=7), 2.0))
    assert "and 245 more" in said
