from __future__ import annotations

import random
import time
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.parser import PacketReader
from tests.mavlink.mavlink_peer import captured, heartbeat, packet, trigger

WHOLE = packet(trigger(7, 1_000_000))
LONG = packet(captured(9, file_url=b"IMG_0009.JPG"), component=100)


def names(reader: PacketReader, data: bytes) -> list[str]:
    return [message.get_type() for message in reader.feed(data)]


@given(st.lists(st.integers(0, 300), max_size=6))
def test_packets_in_pieces_are_put_together(cuts: list[int]) -> None:
    stream, reader = WHOLE + LONG + packet(heartbeat()), PacketReader(datagrams=False)
    edges = sorted({0, len(stream), *(min(cut, len(stream)) for cut in cuts)})
    heard = [name for start, end in pairwise(edges) for name in names(reader, stream[start:end])]
    assert heard == ["CAMERA_TRIGGER", "CAMERA_IMAGE_CAPTURED", "HEARTBEAT"]
    assert reader.skipped_bytes == 0


@given(st.binary(max_size=600), st.booleans())
def test_noise_never_raises_and_costs_no_packet_behind_it(noise: bytes, datagrams: bool) -> None:
    reader = PacketReader(datagrams=datagrams)
    reader.feed(noise)
    heard = [message for _ in range(12) for message in reader.feed(LONG)]
    assert [message.image_index for message in heard][-10:] == [9] * 10


@given(st.data())
def test_a_damaged_packet_is_not_believed(data: st.DataObject) -> None:
    place, bit = data.draw(st.integers(1, len(LONG) - 1)), data.draw(st.integers(0, 7))
    damaged = bytearray(LONG)
    damaged[place] ^= 1 << bit
    reader = PacketReader(datagrams=False)
    reader.feed(bytes(damaged))
    assert all(message.get_type() != "CAMERA_IMAGE_CAPTURED" for message in reader.feed(b""))


def test_a_broken_header_does_not_hide_the_packet_behind_it() -> None:
    assert names(PacketReader(datagrams=False), b"\xfd\x10" + WHOLE + LONG) == [
        "CAMERA_TRIGGER",
        "CAMERA_IMAGE_CAPTURED",
    ]


def test_a_datagram_that_begins_with_a_packet_begins_afresh() -> None:
    reader = PacketReader(datagrams=True)
    assert names(reader, b"\xfd\xff\x00\x00") == []
    assert names(reader, WHOLE) == ["CAMERA_TRIGGER"]
    assert reader.skipped_bytes == 4


def test_a_flag_from_the_future_is_refused() -> None:
    odd = bytearray(WHOLE)
    odd[2] = 0x02
    assert names(PacketReader(datagrams=True), bytes(odd)) == []


def test_three_hundred_kilobytes_of_mutated_packets_do_no_harm() -> None:
    dice, reader = random.Random(1), PacketReader(datagrams=False)
    for _ in range(5_000):
        mutated = bytearray(LONG if dice.random() < 0.3 else WHOLE)
        mutated[dice.randrange(len(mutated))] = dice.randrange(256)
        reader.feed(bytes(mutated)[: dice.randrange(1, len(mutated) + 1)])
    assert names(reader, LONG * 3)[-2:] == ["CAMERA_IMAGE_CAPTURED"] * 2


def test_a_datagram_of_nothing_but_beginnings_costs_little() -> None:
    """65,507 bytes that may each begin a packet; told as a multiple of as many bytes of true packets."""
    true = LONG * (65_507 // len(LONG))
    times = {}
    for name, data in (("true", true), ("false", b"\xfe" * 65_507), ("false 2", b"\xfd\xff\x00" * 21_835)):
        began = time.perf_counter()
        PacketReader(datagrams=True).feed(data)
        times[name] = time.perf_counter() - began
    assert max(times["false"], times["false 2"]) < 3 * times["true"]
