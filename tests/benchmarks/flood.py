"""A flood of forged triggers on the link of a flight: `python -m tests.benchmarks.flood [SECONDS] [RATE]` (60, 5000).

The real program listens on real UDP. A camera takes a picture each half second and says so, in the manner of MAVLink cameras,
while somebody else sends RATE triggers a second in the aircraft's name, each with another counter. Says how many of the
camera's shots were matched with their pictures, what became of the flood, and what the program's memory did.
"""

from __future__ import annotations

import random
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests.running import Running, flying, six_pictures
from tests.sure import sure

SHOT_EVERY_S, SAMPLE_EVERY_S = 0.5, 0.5
SETTLED_S = 2.0  # until what came last is in the ledger; the map itself is of no interest here
BURST_S = 0.005  # what is due in so short a time is sent at once
PACKETS = 4096  # different ones


@dataclass(slots=True)
class Outcome:
    """What a flood did."""

    shots: int = 0
    matched: int = 0  # of the shots
    sent: int = 0  # forged triggers
    recorded: int = 0  # of them, events in the ledger
    seconds: float = 0.0
    memory_mb: list[float] = field(default_factory=list)

    @property
    def growth_mb(self) -> float:
        """From the first third of the flood, when all is warm, to its end."""
        return max(self.memory_mb[-3:]) - max(self.memory_mb[: len(self.memory_mb) // 3])

    def __str__(self) -> str:
        memory = f"memory {self.memory_mb[0]:.0f} MB at first, {self.memory_mb[-1]:.0f} MB at last ({self.growth_mb:+.0f} MB)"
        flood = f"{self.sent} forged triggers in {self.seconds:.0f} s, {self.recorded} of them in the ledger"
        return f"{self.matched} of {self.shots} shots matched; {flood}; {memory}"


class Forger:
    """Sends triggers in the aircraft's name from a thread of its own, as a context."""

    def __init__(self, port: int, rate: float) -> None:
        self.sent = 0
        self._rate, self._stop = rate, threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._packets = list(forged(PACKETS))
        self._thread = threading.Thread(target=self._send)

    def __enter__(self) -> Forger:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _send(self) -> None:
        start = time.monotonic()
        while not self._stop.wait(BURST_S):
            for _ in range(min(int((time.monotonic() - start) * self._rate) - self.sent, PACKETS)):
                self._socket.send(self._packets[self.sent % PACKETS])
                self.sent += 1


def forged(count: int) -> Iterator[bytes]:
    dice, autopilot = random.Random(1), mavlink.MAVLink(None, 1, 1)
    for _ in range(count):
        message = mavlink.MAVLink_camera_trigger_message(dice.randrange(1 << 40), dice.randrange(1 << 32))
        yield bytes(message.pack(autopilot))


def numbered(picture: bytes, number: int) -> bytes:
    """Next to the same picture: with a mark in a corner."""
    image = sure(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR))
    image[:8, :8] = 2 * (number % 128)
    return sure(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]).tobytes()


def flood(home: Path, seconds: float, rate: float, pictures: list[bytes], *options: str) -> Outcome:
    """Fly in the folder `home` with a flood that lasts so long."""
    with flying(home, *options) as flight:
        outcome = Outcome()
        flight.take("first.jpg", numbered(pictures[0], 0))
        flight.wait_for_frames(placed=1)
        port = int(flight.vehicle.socket.getpeername()[1])
        with Forger(port, rate) as forger:
            fly(flight, pictures, seconds, outcome)
        outcome.sent, outcome.shots = forger.sent, flight.taken
        flight.wait_for(lambda status: sum(status["frames"].values()) == flight.taken, "all pictures came")
        time.sleep(SETTLED_S)
        account(flight, outcome)
        return outcome


def fly(flight: Running, pictures: list[bytes], seconds: float, outcome: Outcome) -> None:
    start = time.monotonic()
    sampled = 0.0
    while (now := time.monotonic() - start) < seconds:
        if now >= flight.taken * SHOT_EVERY_S:
            flight.vehicle.tick(None)
            flight.take(f"{flight.taken}.jpg", numbered(pictures[flight.taken % len(pictures)], flight.taken))
        if now >= sampled:
            sampled = now + SAMPLE_EVERY_S
            outcome.memory_mb.append(memory_mb(flight.process.pid))
        time.sleep(0.01)
    outcome.seconds = seconds


def memory_mb(process: int) -> float:
    """What it has in memory now (Linux)."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS:"))


def account(flight: Running, outcome: Outcome) -> None:
    with Ledger(flight.out / LEDGER_NAME, read_only=True) as ledger:
        records = ledger.events()
    real = [record for record in records if record.event.component == 100]
    outcome.matched = sum(record.frame is not None and record.frame == record.event.file_hint for record in real)
    outcome.recorded = len(records) - len(real)


def main(seconds: float = 60.0, rate: float = 5000.0) -> None:
    with tempfile.TemporaryDirectory() as home:
        for each in (0.0, rate):
            pictures = six_pictures(Path(home))
            print(f"{each:g} a second: {flood(Path(home) / f'{each:g}', seconds, each, pictures)}", flush=True)


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
