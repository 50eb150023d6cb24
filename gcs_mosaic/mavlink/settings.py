"""The settings of a link."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from gcs_mosaic.messages import HIGHEST_SYSTEM, expected_system

AircraftIds: TypeAlias = tuple[int, ...] | Literal["all"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """Settings of one link. Times are in seconds."""

    vehicle: int | None = None
    """MAVLink system id of the aircraft to follow; none = the first to trigger a camera."""
    vehicles: tuple[int | Literal["all"], ...] = ()
    """Aircraft of one flight, whose triggers all count, such as [1, 2] or all; none = one is followed."""
    decide_after_s: float = 3.0
    """Wait for the HEARTBEAT of an autopilot before following a system that triggers without: three heartbeats."""
    release_s: float = 30.0
    """A followed aircraft silent for this long gives way to another one that triggers: longer than a turn behind a hill."""
    most_triggers_per_s: float = 20.0
    """Highest sustained trigger rate of a source; one that exceeds it is no camera and is ignored until it is quieter."""
    most_triggers_at_once: int = 200
    """... with this many accepted at once: a burst, or a backlog of the link."""
    silent_after_s: float = 10.0
    """A link without messages for this long is reported silent: ten heartbeats, longer than an aircraft's turn."""
    ground_station_after_s: float = 20.0
    """Wait for a ground station's heartbeat before reporting that none is heard on this link."""
    poll_s: float = 0.25
    """Longest blocking read before the stop flag is checked."""
    connect_timeout_s: float = 3.0
    """Timeout of a TCP connection attempt."""
    reconnect_first_s: float = 0.25
    """First back-off before a lost TCP or serial link is reopened; doubles with each failure."""
    reconnect_longest_s: float = 5.0
    """Longest back-off: nobody wants to wait longer after a repair."""
    announce: int | None = None
    """Own MAVLink system id, such as 191, for sending a heartbeat and warnings; none = nothing is ever sent."""
    recover: bool = False
    """Request messages again, at most one a second, that a gap in the camera's counter shows to be lost."""
    signing_key: str | None = None
    """File (mode 600) with the MAVLink signing key; packets not signed with it are refused."""
    receive_buffer_bytes: int = 1 << 21
    """Socket receive buffer, capped by the kernel's own limit: one second at 5,000 messages a second."""

    def __post_init__(self) -> None:
        for setting, systems in {"vehicle": (self.vehicle,), "vehicles": self.vehicles}.items():
            for system in systems:
                if isinstance(system, int) and not 0 < system <= HIGHEST_SYSTEM:
                    raise ValueError(f"{setting}: {expected_system(system)}")

    @property
    def aircraft(self) -> AircraftIds:
        """The aircraft whose triggers all count; none if one is followed."""
        return "all" if "all" in self.vehicles else tuple(sorted({one for one in self.vehicles if one != "all"}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """The links, and their common settings."""

    # links to listen on, such as udp:14445, tcp:HOST:PORT, serial:/dev/ttyACM0:57600
    mavlink: tuple[str, ...] = ("udp:14550",)
    link: LinkSettings = field(default_factory=LinkSettings)
