"""A message as it came in."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_mosaic.mavlink.messages import MavMessage


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message and when it came, in seconds of the host's monotonic clock; `sender` says from where, if a link can tell."""

    message: MavMessage
    received: float
    sender: str = ""
