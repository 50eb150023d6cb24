"""A received message."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_mosaic.mavlink.messages import MavMessage


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message and its arrival time in monotonic seconds; `sender` is the peer's address, where the link knows it."""

    message: MavMessage
    received: float
    sender: str = ""
    latest: float | None = None  # when it was read, if `received` is an estimate
