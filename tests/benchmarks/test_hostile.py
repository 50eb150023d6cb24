"""What anybody may send: nothing raises, nothing grows, and a real camera is heard among it.

1,800 inputs by hypothesis (200 of each kind), 8,500 in the short form of `python -m tests.benchmarks.hostile`.
"""

from __future__ import annotations

import math
import random
import tracemalloc
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs_mosaic.mavlink.messages import LONGEST_NAME, decode
from gcs_mosaic.mavlink.parser import PacketReader
from gcs_mosaic.messages import TriggerEvent
from tests.benchmarks.hostile import KINDS, MESSAGES, OURS, Ear, attack, framed, shot

pytestmark = pytest.mark.long


READ = [112, 180, 263]
ANY: dict[str, st.SearchStrategy[Any]] = {
    "int8_t": st.integers(-(1 << 7), (1 << 7) - 1),
    "uint8_t": st.integers(0, (1 << 8) - 1),
    "uint16_t": st.integers(0, (1 << 16) - 1),
    "int32_t": st.integers(-(1 << 31), (1 << 31) - 1),
    "uint32_t": st.integers(0, (1 << 32) - 1),
    "uint64_t": st.integers(0, (1 << 64) - 1),
    "float": st.floats(width=32),
    "char": st.text("aZ9./\\%20?#\x00\x1b\u2028é", max_size=60).map(lambda name: name.encode()),
}


def several(one: st.SearchStrategy[Any], count: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(one, min_size=count, max_size=count)


def assert_harmless(event: TriggerEvent) -> None:
    """Whatever was sent, these are values that the rest of the program can live with."""
    times = [time for time in (event.source_time, event.utc) if time is not None]
    assert all(math.isfinite(time) for time in times)
    assert event.utc is None or 2014 <= 1970 + event.utc / 31556952 <= 2100
    assert event.file_hint is None or len(event.file_hint) <= LONGEST_NAME
    names = [] if event.file_hint is None else event.file_hint.split("/")
    assert len(names) <= 2, "a file, after its folder"
    assert all(name.strip(".") and not set(name) & set("\\\x00\n\x1b") for name in names)
    if event.position is not None:
        place = event.position
        assert abs(place.latitude_deg) <= 90
        assert abs(place.longitude_deg) <= 180
        assert place.altitude_m is None or math.isfinite(place.altitude_m)


@settings(max_examples=200)
@pytest.mark.parametrize("message_id", READ)
@given(st.data())
def test_whatever_the_fields_are(message_id: int, data: st.DataObject) -> None:
    kind = MESSAGES[message_id]
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    fields = {
        name: data.draw(ANY[type_] if type_ == "char" or not lengths[name] else several(ANY[type_], lengths[name]))
        for name, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    }
    packet = bytes(kind(**fields).pack(dialect.MAVLink(None, 1, 100)))
    (message,) = PacketReader(datagrams=True).feed(packet)
    event = decode(message, 1.0)
    if event is not None:
        assert_harmless(event)


@settings(max_examples=200)
@given(st.sampled_from(OURS), st.binary(max_size=255), st.integers(0, 255), st.integers(0, 255))
def test_whatever_the_payload_is(message_id: int, payload: bytes, system: int, component: int) -> None:
    """Shorter and longer than the message, with a right checksum."""
    for message in PacketReader(datagrams=True).feed(framed(message_id, payload, system, component)):
        event = decode(message, 1.0)
        if event is not None:
            assert_harmless(event)


@settings(max_examples=200)
@pytest.mark.parametrize("kind", KINDS)
@given(dice=st.randoms(use_true_random=False), pieces=st.integers(1, 40))
def test_whatever_the_bytes_are(kind: str, dice: random.Random, pieces: int) -> None:
    """In pieces of any length, and then a camera's shot, which is heard at the latest when the next has come."""
    ear = Ear(datagrams=False)
    data = KINDS[kind](dice) + shot(1) + shot(2) * 4
    heard = [event for start in range(0, len(data), pieces) for event in ear.hear(data[start : start + pieces], 1.0)]
    for event in heard:
        assert_harmless(event)
    assert 1 in [event.sequence for event in heard]


@pytest.mark.parametrize("datagrams", [False, True], ids=["a stream", "datagrams"])
def test_among_three_hundred_kilobytes_of_it_every_real_shot_is_heard(datagrams: bool) -> None:
    outcome = attack(300_000, datagrams=datagrams)
    assert outcome.heard == outcome.shots == 60
    assert sum(outcome.inputs.values()) > 3000
    assert outcome.events > 10  # of the forged ones some are let through, so that they too are put to the test


def test_nothing_of_it_is_kept() -> None:
    """Once every system has been heard, and the newest of each kind are remembered, 2,000 more inputs take no more memory."""
    ear, dice = Ear(datagrams=False), random.Random(2)
    for system in range(256):
        for message_id in OURS:
            take(ear, framed(message_id, bytes([7] * 40), system, 1))
    tracemalloc.start()
    held = []
    for _ in range(4):
        for _ in range(2000):
            take(ear, KINDS[dice.choice(list(KINDS))](dice))
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    kept = held[-1] - held[-2]
    assert kept < 20_000


def take(ear: Ear, data: bytes) -> None:
    for message in ear.reader.feed(data):
        list(ear.listener.hear(message, 1.0))
