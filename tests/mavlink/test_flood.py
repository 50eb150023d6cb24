from __future__ import annotations

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.flood import MOST_SOURCES, UNKNOWN_AT_ONCE, FloodGate, Trust
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import CaptureResult, Notice, Source, StreamOffer, Teller, TriggerEvent
from tests.mavlink.mavlink_peer import captured, packet, received, trigger

CAMERA = Teller("", 1, 100, Source.IMAGE_CAPTURED_BY_CAMERA)
FORGER = Teller("", 1, 1, Source.CAMERA_TRIGGER)


def event(source: Teller, now: float) -> TriggerEvent:
    return TriggerEvent(
        vehicle=source.system, component=source.component, camera=0, source=source.source, sequence=1, received=now,
        source_time=None, clock="none", utc=None, result=CaptureResult.UNKNOWN, file_hint=None, position=None,
        sender=source.sender,
    )  # fmt: skip


def trusting(*sources: Teller) -> Trust:
    trust = Trust()
    trust.sources = frozenset(sources)
    return trust


def passed(gate: FloodGate, source: Teller, times: list[float]) -> int:
    """How many are let in, at once or later."""
    count = 0
    for time in times:
        count += len(list(gate.ripe(time))) + len(gate.ask(event(source, time))[1])
    return count


def test_a_camera_passes_however_long_it_goes_on() -> None:
    gate = FloodGate(20, 200)
    assert passed(gate, CAMERA, [k / 15 for k in range(5_000)]) == 5_000
    assert gate.left_out == 0


def test_a_burst_camera_and_two_others_pass_before_any_of_their_pictures_is_found() -> None:
    gate = FloodGate(20, 200)
    sources = [CAMERA, CAMERA._replace(component=101), FORGER, FORGER._replace(source=Source.CAMERA_FEEDBACK)]
    admitted = sum(passed(gate, source, [0.2 * k]) for k in range(600) for source in sources)
    assert admitted == 4 * 600


def test_what_a_link_held_back_of_a_known_camera_passes_at_once() -> None:
    assert passed(FloodGate(20, 200, trusting(CAMERA)), CAMERA, [10.0] * 200) == 200


def test_what_a_link_held_back_of_an_unknown_camera_passes_when_it_is_seen_to_be_no_flood() -> None:
    gate = FloodGate(20, 200)
    assert passed(gate, CAMERA, [10.0] * 150) == UNKNOWN_AT_ONCE
    assert list(gate.ripe(11.0)) == []
    assert len(list(gate.ripe(20.0))) == 150 - UNKNOWN_AT_ONCE
    assert gate.left_out == 0


def test_a_flood_ends_its_own_source_and_no_other() -> None:
    gate = FloodGate(20, 200)
    admitted = 0
    for k in range(10_000):
        admitted += len(gate.ask(event(FORGER, k / 5000))[1])
        if k % 2500 == 0:
            assert gate.ask(event(CAMERA, k / 5000))[0] == "admitted"
    assert UNKNOWN_AT_ONCE <= admitted <= UNKNOWN_AT_ONCE + 2
    assert gate.left_out == 10_000 - admitted


def test_a_crowd_in_the_aircrafts_name_costs_the_real_camera_nothing() -> None:
    """39 sources, 5,000 messages a second in all; the camera speaks after them, and nobody knows it yet."""
    gate, forged, real = FloodGate(20, 200), 0, 0
    for k in range(20_000):
        now = k / 5000
        forged += len(list(gate.ripe(now))) if k % 1000 == 0 else 0
        forged += len(gate.ask(event(FORGER._replace(component=2 + k % 39), now))[1])
        if k % 500 == 250:
            real += len(gate.ask(event(CAMERA, now))[1])
    assert real == 40
    assert forged < 300
    assert gate.is_crowded


def test_a_source_is_listened_to_again_when_it_is_quiet() -> None:
    gate = FloodGate(20, 200)
    passed(gate, CAMERA, [0.0] * 500)
    verdicts = [gate.ask(event(CAMERA, 0.5 * k))[0] for k in range(1, 31)]
    assert "opened" in verdicts
    assert set(verdicts[: verdicts.index("opened")]) == {"left out"}
    assert set(verdicts[verdicts.index("opened") + 1 :]) == {"admitted"}


def test_another_name_for_each_message_does_not_help() -> None:
    gate = FloodGate(20, 200, trusting(CAMERA))
    names = [FORGER._replace(component=k % 256, sender=str(k % 7)) for k in range(10_000)]
    admitted = 0
    for k, name in enumerate(names):
        admitted += len(gate.ask(event(name, k / 5000))[1])
        if k % 2500 == 0:
            assert gate.ask(event(CAMERA, k / 5000))[0] == "admitted"
    assert admitted <= 200 + 2 * 20 + 1


def test_sources_that_fill_the_places_before_the_camera_give_one_up() -> None:
    gate = FloodGate(20, 200)
    for k in range(2 * MOST_SOURCES):
        assert gate.ask(event(FORGER._replace(component=k), 0.0))[0] == "admitted"
    assert gate.ask(event(CAMERA, 0.1))[0] == "admitted"
    assert gate.is_crowded


def test_a_trusted_source_never_gives_up_its_place() -> None:
    gate = FloodGate(20, 200, trusting(CAMERA))
    passed(gate, CAMERA, [0.0] * 100)
    for k in range(1000):
        gate.ask(event(FORGER._replace(component=k % 256, sender=str(k)), 0.0))
    assert CAMERA in gate._buckets


def test_a_flood_that_goes_on_is_known_by_its_header() -> None:
    gate = FloodGate(20, 200)
    passed(gate, FORGER, [0.0] * 500)
    flood, camera = packet(trigger(1)), packet(captured(1), component=100)
    assert gate.skips("", flood, 0.1)
    assert not gate.skips("elsewhere", flood, 0.1)
    assert not gate.skips("", flood + camera, 0.1), "two messages in one datagram"
    assert not gate.skips("", camera, 0.1)
    assert not gate.skips("", flood[:9], 0.1)
    assert not gate.skips("", flood, 60.0), "quiet for so long: it is asked again"


def test_the_operator_hears_of_a_flood_once_and_of_its_end() -> None:
    listener = Listener(
        parse_address("udp:14550"), LinkSettings(), VehicleChoice(LinkSettings(decide_after_s=0)), 0.0, lambda: 0.0
    )
    told: list[TriggerEvent | StreamOffer | Notice] = []
    for k in range(3000):
        told += listener.hear(received(trigger(k)), k / 1000, "a")
    told += listener.hear(received(captured(1), component=100), 3.0, "b")
    told += listener.hear(received(trigger(3000)), 30.0, "a")
    events = [item for item in told if isinstance(item, TriggerEvent)]
    assert [event.component for event in events[-2:]] == [100, 1]
    texts = [item.text for item in told if isinstance(item, Notice)]
    assert [("left out until" in text, "is quieter again" in text) for text in texts[1:]] == [
        (True, False),
        (False, True),
    ]
    assert "CAMERA_TRIGGER of system 1, component 1" in texts[1]


def test_the_operator_hears_of_a_crowd_once_and_of_few_of_its_members() -> None:
    listener = Listener(
        parse_address("udp:14550"), LinkSettings(), VehicleChoice(LinkSettings(decide_after_s=0)), 0.0, lambda: 0.0
    )
    texts = []
    for k in range(4_000):
        heard = listener.hear(received(trigger(k), component=2 + k % 39), k / 5000, "a")
        texts += [item.text for item in heard if isinstance(item, Notice)]
    assert len([text for text in texts if "more sources trigger cameras" in text]) == 1
    assert len([text for text in texts if "as from no camera" in text]) == 2
    assert len(texts) == 4
