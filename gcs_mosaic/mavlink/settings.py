"""The settings of a link."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """How a link is listened to. Times are in seconds."""

    vehicle: int | None = None
    """MAVLink system id of the aircraft to follow; none = the first that triggers a camera."""
    most_triggers_per_s: float = 20.0
    """A source that announces more pictures a second for longer is no camera, and is left out until it is quieter."""
    most_triggers_at_once: int = 200
    """... and so many at once are believed: what a link held back, or a burst."""
    silent_after_s: float = 10.0
    """A link that brings nothing for so long is said to be silent: ten heartbeats, more than a turn of the aircraft."""
    ground_station_after_s: float = 20.0
    """How long to wait for a ground station's heartbeat before saying that none is heard on this link."""
    poll_s: float = 0.25
    """Longest wait for bytes before looking whether to stop."""
    connect_timeout_s: float = 3.0
    """Longest wait for a TCP connection."""
    reconnect_first_s: float = 0.25
    """Wait before a lost TCP or serial link is opened again; it doubles with each failure."""
    reconnect_longest_s: float = 5.0
    """Longest such wait: after a repair nobody wants to wait longer."""
    announce: int | None = None
    """Own MAVLink system id, such as 191, under which a heartbeat and warnings are sent; none = nothing is ever sent."""
    recover: bool = False
    """Ask a camera again, at most once a second, for messages of which its counter shows that they were lost."""
    signing_key: str | None = None
    """File (mode 600) with the key of MAVLink's signing; packets that are not signed with it are refused."""
    receive_buffer_bytes: int = 1 << 21
    """What the kernel keeps for us while we are busy, as far as its own limit allows: a second of 5,000 messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """What is listened to, and how."""

    # links to listen on, such as udp:14445, tcp:HOST:PORT, serial:/dev/ttyACM0:57600
    mavlink: tuple[str, ...] = ("udp:14550",)
    link: LinkSettings = field(default_factory=LinkSettings)
