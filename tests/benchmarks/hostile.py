"""Random and mutated bytes through all that hears: `python -m tests.benchmarks.hostile [BYTES]` (10,000,000).

Noise, cut, mutated and overlong packets, wrong checksums, and packets of every kind of message whose checksum is right and whose
fields are anything (NaN, infinities, absurd times and names), between a real camera's shots, as a stream and as datagrams. Says
how many inputs were tried, that all real shots were heard, and what the memory did.
"""

from __future__ import annotations

import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.parser import PacketReader
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import TriggerEvent
from gcs_mosaic.triggers import Pairing
from gcs_mosaic.triggers.shots import New, ShotMerger

BYTES = 10_000_000
SHOT_EACH_BYTES, SHOT_EVERY_S = 5000, 0.5
VEHICLE, CAMERA = 1, 100
MESSAGES = dialect.mavlink_map
OURS = [112, 180, 263, 0, 2]  # what is read: camera messages, HEARTBEAT, SYSTEM_TIME
LONGEST_PAYLOAD = 255
ODD = [b"\x00", b"\xff", b"\x7f\xff", b"\x7f\xc0\x00\x00", b"\x80\x00\x00\x00", b"\x00\x00\xc0\x7f", b"../%2e%00\x1b["]

Dice = random.Random


def framed(message_id: int, payload: bytes, system: int, component: int) -> bytes:
    """A MAVLink 2 packet with the right checksum, whatever is in it."""
    body = bytes([len(payload), 0, 0, 0, system, component]) + message_id.to_bytes(3, "little") + payload
    checksum = dialect.x25crc(body)
    checksum.accumulate(bytes([MESSAGES[message_id].crc_extra]))
    return b"\xfd" + body + int(checksum.crc).to_bytes(2, "little")


def anything(dice: Dice) -> bytes:
    """A packet that is right but for its content; a fifth are longer than their message."""
    message_id = dice.choice(OURS if dice.random() < 0.5 else list(MESSAGES))
    length = dice.randrange(LONGEST_PAYLOAD + 1) if dice.random() < 0.2 else MESSAGES[message_id].unpacker.size
    odd = b"".join(dice.choice(ODD) for _ in range(length))[:length]
    payload = odd if dice.random() < 0.3 else dice.randbytes(length)
    component = dice.choice([1, CAMERA, dice.randrange(256)])
    return framed(message_id, payload, dice.choice([VEHICLE, dice.randrange(256)]), component)


def mutated(dice: Dice) -> bytes:
    packet = bytearray(anything(dice))
    for _ in range(dice.randrange(1, 4)):
        packet[dice.randrange(len(packet))] = dice.randrange(256)
    return bytes(packet)


def cut(dice: Dice) -> bytes:
    packet = anything(dice)
    return packet[: dice.randrange(1, len(packet))]


def wrong_checksum(dice: Dice) -> bytes:
    packet = anything(dice)
    return packet[:-1] + bytes([packet[-1] ^ dice.randrange(1, 256)])


def noise(dice: Dice) -> bytes:
    return dice.randbytes(dice.randrange(1, 300))


KINDS: dict[str, Callable[[Dice], bytes]] = {
    "packets with any content": anything,
    "mutated packets": mutated,
    "cut packets": cut,
    "wrong checksums": wrong_checksum,
    "stretches of noise": noise,
}


def shot(index: int) -> bytes:
    """A real camera's message."""
    camera = dialect.MAVLink(None, VEHICLE, CAMERA)
    place = (0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0])
    told = dialect.MAVLink_camera_image_captured_message(500 * index, 0, 0, *place, index, 1, named(index).encode())
    return bytes(told.pack(camera))


def named(index: int) -> str:
    return f"IMG_{index:05d}.JPG"


@dataclass(slots=True)
class Outcome:
    """What was tried and what came of it."""

    inputs: Counter[str] = field(default_factory=Counter)
    size: int = 0  # bytes
    shots: int = 0
    heard: int = 0  # of the shots
    events: int = 0  # others that were let through
    seconds: float = 0.0
    memory_mb: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        tried = ", ".join(f"{count} {kind}" for kind, count in self.inputs.items())
        memory = (
            f"{self.memory_mb[len(self.memory_mb) // 10]:.1f} MB after a tenth, {self.memory_mb[-1]:.1f} MB at the end"
        )
        heard = f"{self.heard} of {self.shots} real shots heard, {self.events} other events"
        return f"{self.size} bytes in {self.seconds:.0f} s: {tried}; {heard}; memory {memory}"


class Ear:
    """All that a message goes through in the program, from bytes to what becomes of events."""

    def __init__(self, *, datagrams: bool) -> None:
        settings = LinkSettings(vehicle=VEHICLE)
        self.reader = PacketReader(datagrams=datagrams)
        self.listener = Listener(parse_address("udp:14550"), settings, VehicleChoice(settings), 0.0, lambda: 0.0)
        self.merger, self.pairing, self.known = ShotMerger(), Pairing(), 0

    def hear(self, data: bytes, now: float) -> Iterator[TriggerEvent]:
        for message in self.reader.feed(data):
            for item in self.listener.hear(message, now):
                if isinstance(item, TriggerEvent):
                    self.settle(item, now)
                    yield item
        list(self.listener.tick(now, noise=self.reader.skipped_bytes))

    def settle(self, event: TriggerEvent, now: float) -> None:
        self.known += 1
        verdict = self.merger.add(self.known, event)
        if isinstance(verdict, New):
            self.pairing.event(self.known, event, verdict.moment, now)
        self.pairing.tick(now)


def attack(size: int, *, datagrams: bool, seed: int = 1) -> Outcome:
    """So many bytes."""
    dice, ear, outcome = random.Random(seed), Ear(datagrams=datagrams), Outcome()
    start, wanted = time.perf_counter(), set[int]()
    while outcome.size < size:
        now = outcome.size / SHOT_EACH_BYTES * SHOT_EVERY_S
        if outcome.size >= outcome.shots * SHOT_EACH_BYTES:
            kind, data = "", shot(outcome.shots)
            wanted.add(outcome.shots)
            outcome.shots += 1
            outcome.memory_mb.append(memory_mb())
        else:
            kind = dice.choice(list(KINDS))
            data = KINDS[kind](dice)
            outcome.inputs[kind] += 1
        outcome.size += len(data)
        for event in ear.hear(data, now):
            if event.sequence in wanted and event.file_hint == named(event.sequence):
                wanted.remove(event.sequence)
                outcome.heard += 1
            else:
                outcome.events += 1
    outcome.seconds = time.perf_counter() - start
    return outcome


def memory_mb() -> float:
    """What this process has in memory now (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS:"))


def main(size: int = BYTES) -> None:
    for datagrams in (False, True):
        print(f"{'datagrams' if datagrams else 'a stream'}: {attack(size, datagrams=datagrams)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
