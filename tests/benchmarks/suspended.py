"""A laptop that is suspended in flight: `python -m tests.benchmarks.suspended [udp|tcp] [SECONDS]` (udp, 20).

The real program is stopped (SIGSTOP) for so long while an aircraft goes on flying: 25 shots at one a second, of which half
happen meanwhile. Neither names nor counters connect events and files, so their times alone must. Says how many shots have
their own picture. The manner is an autopilot's without a feedback pin: CAMERA_TRIGGER without a time.
"""

from __future__ import annotations

import signal
import socket
import sys
import tempfile
import time
from pathlib import Path
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests.benchmarks.flood import numbered
from tests.running import Running, flying, six_pictures

SHOTS, SHOT_EVERY_S, STOPPED_AT = 25, 1.0, 3
DELAY_S = 0.3  # from the shot to its file
NAMES = [f"{chr(ord('a') + 7 * k % 26)}{chr(ord('a') + k)}.jpg" for k in range(26)]  # neither numbers nor an order


class Sends(Protocol):
    """A socket that is connected to the program."""

    def send(self, data: bytes, /) -> int: ...


def fly(flight: Running, link: Sends, pictures: list[bytes], stopped_s: float, shots: int = SHOTS) -> None:
    """Take the pictures; the program stands still for `stopped_s` after some."""
    autopilot = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    start, stopped = time.monotonic(), False
    for number in range(shots):
        fly_on(link, autopilot, start + number * SHOT_EVERY_S)
        if number == STOPPED_AT:
            flight.process.send_signal(signal.SIGSTOP)
            stopped = True
        if stopped and time.monotonic() - start > STOPPED_AT * SHOT_EVERY_S + stopped_s:
            flight.process.send_signal(signal.SIGCONT)
            stopped = False
        link.send(bytes(heartbeat().pack(autopilot)))
        link.send(bytes(mavlink.MAVLink_camera_trigger_message(0, number).pack(autopilot)))
        fly_on(link, autopilot, start + number * SHOT_EVERY_S + DELAY_S)
        flight.taken += 1
        flight.bring(NAMES[number], numbered(pictures[number % len(pictures)], number))
    flight.process.send_signal(signal.SIGCONT)


def heartbeat() -> mavlink.MAVLink_heartbeat_message:
    return mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)


def fly_on(link: Sends, autopilot: mavlink.MAVLink, until: float) -> None:
    """Telemetry at ten a second."""
    while (left := until - time.monotonic()) > 0:
        link.send(bytes(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(autopilot)))
        time.sleep(min(0.1, left))


def matched(out: Path) -> int:
    """How many shots have their own picture."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        records = ledger.events()
    return sum(record.frame == NAMES[record.event.sequence or 0] for record in records)


def over_udp(home: Path, pictures: list[bytes], stopped_s: float, shots: int = SHOTS) -> int:
    """Fly over UDP; returns how many shots have their own picture."""
    with flying(home) as flight:
        fly(flight, flight.vehicle.socket, pictures, stopped_s, shots)
        return settled(flight, shots)


def over_tcp(home: Path, pictures: list[bytes], stopped_s: float, shots: int = SHOTS) -> int:
    """Fly over TCP; returns how many shots have their own picture."""
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        flying(home, "--mavlink", f"tcp:127.0.0.1:{server.getsockname()[1]}") as flight,
        server.accept()[0] as link,
    ):
        fly(flight, link, pictures, stopped_s, shots)
        return settled(flight, shots)


def settled(flight: Running, shots: int) -> int:
    flight.wait_for(lambda status: sum(status["frames"].values()) == shots, "all pictures came")
    flight.wait_for(lambda status: sum(status["events"].values()) == shots, "all triggers came")
    assert flight.end(signal.SIGTERM) == 0
    return matched(flight.out)


def main(way: str = "udp", stopped_s: float = 20.0) -> None:
    with tempfile.TemporaryDirectory() as home:
        found = {"udp": over_udp, "tcp": over_tcp}[way](Path(home) / "flight", six_pictures(Path(home)), stopped_s)
    print(f"over {way}, stopped for {stopped_s:g} s: {found} of {SHOTS} shots have their own picture")


if __name__ == "__main__":
    main(sys.argv[1] if sys.argv[1:] else "udp", float(sys.argv[2]) if sys.argv[2:] else 20.0)
