"""A vehicle on a UDP link: sends telemetry and camera messages, optionally with link faults."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from .geometry import CameraState
from .messages import (
    AUTOPILOT,
    CAMERA,
    MANNERS,
    Capture,
    Moment,
    Sent,
    global_position,
    heartbeats,
    system_time,
)

SYSTEM = 1  # system id of a lone aircraft; 255 is the ground station's
BOOTED_BEFORE = 90.0  # seconds from boot to the start of the flight
HEARTBEAT_EVERY, POSITION_EVERY = 1.0, 0.25  # seconds


@dataclass(slots=True, kw_only=True)
class Faults:
    """Link faults of camera messages: probabilities of being dropped, duplicated, or held back until the next one."""

    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    seed: int = 1
    held: list[Sent] = field(default_factory=list)
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 6])

    def passed(self, messages: Iterable[Sent]) -> Iterator[Sent]:
        """The messages that are sent now, in order."""
        for message in messages:
            lost, twice, late = self.rng.random(3) < (self.drop, self.duplicate, self.reorder)
            if lost:
                continue
            before, self.held = self.held, []
            if late and not before:
                self.held = [message] * (1 + int(twice))
                continue
            yield from [message] * (1 + int(twice))
            yield from before


class Vehicle:
    """A system with an autopilot (component 1) and, in the manner `camera`, a camera (component 100), sending MAVLink 2 to one
    UDP address. Has no thread: call `tick` often to send what is due."""

    def __init__(
        self,
        host: str,
        port: int,
        manners: Iterable[str] = ("px4",),
        faults: Faults | None = None,
        system: int = SYSTEM,
    ) -> None:
        """Raises ValueError for a manner other than px4, ardupilot, camera."""
        self.manners = tuple(manners)
        if not self.manners or set(self.manners) - set(MANNERS):
            raise ValueError(
                f"the vehicle's manners are {', '.join(MANNERS)}, not {','.join(self.manners) or 'nothing'}"
            )
        self.faults = faults or Faults()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((host, port))
        self.voices = {part: mavlink.MAVLink(self, system, part) for part in (AUTOPILOT, CAMERA)}
        self.booted = time.monotonic() - BOOTED_BEFORE
        self.due = {"heartbeat": 0.0, "position": 0.0}

    def tick(self, state: CameraState | None) -> None:
        """Send HEARTBEAT and SYSTEM_TIME once a second, GLOBAL_POSITION_INT (if known) four times a second."""
        now = self.moment()
        if self.is_due("heartbeat", HEARTBEAT_EVERY):
            self.send([*heartbeats(self.manners), system_time(now)])
        if state is not None and self.is_due("position", POSITION_EVERY):
            self.send([global_position(state, now)])

    def is_due(self, what: str, every: float) -> bool:
        now = time.monotonic()
        if now < self.due[what]:
            return False
        self.due[what] = now + every
        return True

    def capture(self, capture: Capture) -> None:
        """Announce a picture in every manner, subject to the link faults."""
        now = self.moment()
        for manner in self.manners:
            self.send(self.faults.passed(MANNERS[manner](capture, now)))

    def moment(self) -> Moment:
        return Moment(boot=time.monotonic() - self.booted, utc=time.time())

    def send(self, messages: Iterable[Sent]) -> None:
        for component, message in messages:
            self.voices[component].send(message)

    def write(self, packet: Any) -> None:
        """Called by pymavlink. A refused datagram is no error: the receiver may not be listening yet."""
        try:
            self.socket.send(bytes(packet))
        except ConnectionRefusedError:
            return

    def close(self) -> None:
        self.send(self.faults.held)
        self.socket.close()
