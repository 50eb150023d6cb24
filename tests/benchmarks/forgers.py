"""Forged triggers in the aircraft's own name: `python -m tests.benchmarks.forgers [crowd|places|counters|all] [SHOTS]` (all, 40).

The real program listens on real UDP; a real aircraft takes two pictures a second. Meanwhile somebody else sends

* crowd: 5,000 triggers a second in all, from 39 component ids of the aircraft;
* places: two triggers from each of 20 component ids, before the camera speaks;
* counters: 39 triggers at 17 a second as the camera itself, with counters ahead of its own.

Each is flown with the camera's messages naming their files (263), and without names and with numbered files (180). Says how
many real shots have their own picture, and how many forged triggers are in the ledger.
"""

from __future__ import annotations

import random
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests.benchmarks.flood import numbered
from tests.running import Running, flying, six_pictures

Manner = Literal["named", "numbered"]
Attack = Literal["crowd", "places", "counters", "none"]

SHOT_EVERY_S, DELAY_S = 0.5, 0.15
CROWD, CROWD_RATE = range(2, 41), 5000.0
FIRST_FILE = 500  # number of the first file: counters begin at 1
COMPONENT = {"named": 100, "numbered": 1}


def message(manner: Manner, count: int, seconds: float, mark: int = 0) -> mavlink.MAVLink_message:
    """What a camera or an autopilot says of a picture; `mark` tells real ones in the ledger, by their height."""
    if manner == "named":
        name = f"DSC{FIRST_FILE + count:05d}.jpg".encode() if mark else b""
        ms, height = int(seconds * 1e3), mark * 1000
        return mavlink.MAVLink_camera_image_captured_message(ms, 0, 0, 1, 1, height, 0, [1, 0, 0, 0], count, 1, name)
    where = (1, 1, float(mark), 0.0, 0.0, 0.0, 0.0, 0.0, 0)
    return mavlink.MAVLink_camera_feedback_message(int(seconds * 1e6), 0, 0, count % 65536, *where)


class Voice:
    """A socket to the program, and what it says as any component of system 1."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.sent = 0

    def say(self, told: mavlink.MAVLink_message, component: int) -> None:
        self.socket.send(bytes(told.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component))))
        self.sent += 1


def crowd(voice: Voice, manner: Manner, stop: threading.Event) -> None:
    """Packed before, or Python would not be fast enough."""
    dice, start = random.Random(1), time.monotonic()
    packets = []
    for k in range(4096):
        sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=CROWD[k % len(CROWD)])
        packets.append(bytes(message("numbered", dice.randrange(65536), dice.random() * 4000).pack(sender)))
    while not stop.wait(0.005):
        for _ in range(min(int((time.monotonic() - start) * CROWD_RATE) - voice.sent, 400)):
            voice.socket.send(packets[voice.sent % len(packets)])
            voice.sent += 1


def places(voice: Voice, manner: Manner, stop: threading.Event) -> None:
    for k in range(40):
        voice.say(message("numbered", 7000 + k, 50.0 + k), 2 + k % 20)


def counters(voice: Voice, manner: Manner, stop: threading.Event) -> None:
    for count in range(1, 40):
        if not stop.wait(1 / 17):
            voice.say(message(manner, count, 90.0 + count / 17), COMPONENT[manner])


ATTACKS: dict[Attack, tuple[Callable[[Voice, Manner, threading.Event], None], bool]] = {
    "crowd": (crowd, False),
    "places": (places, True),  # True: before the camera speaks
    "counters": (counters, False),
    "none": (lambda voice, manner, stop: None, True),
}


@contextmanager
def attacked(port: int, attack: Attack, manner: Manner) -> Iterator[Voice]:
    """The attack, on a thread until it ends."""
    voice, stop = Voice(port), threading.Event()
    run, before = ATTACKS[attack]
    thread = threading.Thread(target=run, args=(voice, manner, stop))
    thread.start()
    if before:
        thread.join()
        time.sleep(0.5)
    try:
        yield voice
    finally:
        stop.set()
        thread.join()
        voice.socket.close()


def fly(flight: Running, manner: Manner, attack: Attack, pictures: list[bytes], shots: int) -> int:
    """Take the pictures under attack; returns the number of forged triggers."""
    port = int(flight.vehicle.socket.getpeername()[1])
    camera, booted = Voice(port), time.monotonic() - 90.0
    flight.vehicle.tick(None)
    with attacked(port, attack, manner) as forger:
        start = time.monotonic()
        for number in range(1, shots + 1):
            time.sleep(max(0.0, start + number * SHOT_EVERY_S - time.monotonic()))
            flight.vehicle.tick(None)
            camera.say(message(manner, number, time.monotonic() - booted, mark=number), COMPONENT[manner])
            time.sleep(DELAY_S)
            flight.taken += 1
            flight.bring(f"DSC{FIRST_FILE + number:05d}.jpg", numbered(pictures[number % len(pictures)], number))
    camera.socket.close()
    return forger.sent


def outcome(
    home: Path, manner: Manner, attack: Attack, pictures: list[bytes], shots: int = 40
) -> tuple[int, int, int, str]:
    """Matched shots, forged rows in the ledger, forged triggers sent, what was said."""
    with flying(home) as flight:
        sent = fly(flight, manner, attack, pictures, shots)
        flight.wait_for(lambda status: sum(status["frames"].values()) == shots, "all pictures came")
        time.sleep(2.0)
        assert flight.end() == 0
        with Ledger(flight.out / LEDGER_NAME, read_only=True) as ledger:
            records = ledger.events()
        marked = [(round(record.event.position.altitude_m or 0), record) for record in records if record.event.position]
        marked = [one for one in marked if one[0]]
        own = {mark for mark, record in marked if record.frame == f"DSC{FIRST_FILE + mark:05d}.jpg"}
        return len(own), len(records) - len(marked), sent, flight.said


def main(which: str = "all", shots: str = "40") -> None:
    attacks: list[Attack] = ["none", "places", "counters", "crowd"]
    with tempfile.TemporaryDirectory() as home:
        pictures = six_pictures(Path(home))
        for attack in attacks:
            manners: tuple[Manner, ...] = ("named", "numbered")
            for manner in manners if which in ("all", attack) else ():
                own, rows, sent, said = outcome(Path(home) / attack / manner, manner, attack, pictures, int(shots))
                print(
                    f"{attack}, {manner}: {own} of {shots} shots have their picture; {rows} of {sent} forged in the ledger"
                )
                print(
                    *(f"    {line}" for line in said.splitlines() if "left out" in line or "trigger" in line), sep="\n"
                )


if __name__ == "__main__":
    main(*sys.argv[1:])
