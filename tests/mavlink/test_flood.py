from __future__ import annotations

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.flood import MOST_SOURCES, FloodGate, TriggerSource
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import Notice, StreamOffer, TriggerEvent
from tests.mavlink.mavlink_peer import captured, received, trigger

CAMERA = TriggerSource("", 1, 100, "CAMERA_IMAGE_CAPTURED")
FORGER = TriggerSource("", 1, 1, "CAMERA_TRIGGER")


def passed(gate: FloodGate, source: TriggerSource, times: list[float]) -> int:
    return sum(gate.ask(source, time) in ("admitted", "opened") for time in times)


def test_a_camera_passes_however_long_it_goes_on() -> None:
    gate = FloodGate(20, 200)
    assert passed(gate, CAMERA, [k / 15 for k in range(20_000)]) == 20_000
    assert gate.left_out == 0


def test_what_a_link_held_back_passes_at_once() -> None:
    assert passed(FloodGate(20, 200), CAMERA, [10.0] * 200) == 200


def test_a_flood_ends_its_own_source_and_no_other() -> None:
    gate = FloodGate(20, 200)
    admitted = 0
    for k in range(100_000):
        admitted += gate.ask(FORGER, k / 5000) == "admitted"
        if k % 2500 == 0:
            assert gate.ask(CAMERA, k / 5000) == "admitted"
    assert 200 <= admitted <= 202
    assert gate.left_out == 100_000 - admitted


def test_a_source_is_listened_to_again_when_it_is_quiet() -> None:
    gate = FloodGate(20, 200)
    passed(gate, CAMERA, [0.0] * 500)
    verdicts = [gate.ask(CAMERA, 0.5 * k) for k in range(1, 21)]
    assert "opened" in verdicts
    assert set(verdicts[: verdicts.index("opened")]) == {"left out"}
    assert set(verdicts[verdicts.index("opened") + 1 :]) == {"admitted"}


def test_another_name_for_each_message_does_not_help() -> None:
    gate = FloodGate(20, 200)
    gate.ask(CAMERA, 0.0)
    names = [FORGER._replace(component=k % 256, sender=str(k % 7)) for k in range(100_000)]
    admitted = sum(gate.ask(name, k / 5000) == "admitted" for k, name in enumerate(names))
    assert admitted <= (MOST_SOURCES - 1) * (200 + 20 * 20 + 1)
    assert gate.ask(CAMERA, 20.0) == "admitted"


def test_a_source_that_has_gone_makes_room() -> None:
    gate = FloodGate(20, 200)
    for k in range(MOST_SOURCES):
        assert gate.ask(FORGER._replace(component=k), 0.0) == "admitted"
    assert gate.ask(CAMERA, 59.0) == "left out"
    assert gate.ask(CAMERA, 61.0) == "admitted"


def test_the_operator_hears_of_a_flood_once_and_of_its_end() -> None:
    listener = Listener(
        parse_address("udp:14550"), LinkSettings(), VehicleChoice(LinkSettings(decide_after_s=0)), 0.0, 0.0
    )
    told: list[TriggerEvent | StreamOffer | Notice] = []
    for k in range(3000):
        told += listener.hear(received(trigger(k)), k / 1000, "a")
    told += listener.hear(received(captured(1), component=100), 3.0, "b")
    told += listener.hear(received(trigger(3000)), 30.0, "a")
    events = [item for item in told if isinstance(item, TriggerEvent)]
    assert [event.component for event in events[-2:]] == [100, 1]
    texts = [item.text for item in told if isinstance(item, Notice)]
    assert [("is left out" in text, "is quieter again" in text) for text in texts[1:]] == [(True, False), (False, True)]
    assert "CAMERA_TRIGGER of system 1, component 1" in texts[1]
