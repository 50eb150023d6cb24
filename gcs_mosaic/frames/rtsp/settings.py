"""The settings of a live stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.frames.rtsp.interval import parse_every


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings:
    """How a live stream is received, and which of its pictures are taken. Times are in seconds."""

    transport: Literal["tcp", "udp"] = "tcp"
    """Over "udp" a bad link loses pictures instead of time; what is damaged is never taken."""
    every: str | None = None
    """Frames without triggers: "1 s" takes one a second, "overlap" one whenever the view has moved; none = triggers only."""
    moved: float = 0.3
    """Share of the picture that must be new before "overlap" takes a frame: 70 % in common is what mapping flights have."""
    latency_s: float = 0.15
    """From capture to arrival at the fastest; used where the camera sends no time that can be believed."""
    window_s: float = 0.15
    """A picture this near to the trigger may be taken instead of the nearest, if that one is blurred or damaged."""
    sharp_enough: float = 0.5
    """Below this share of the sharpest one's energy a picture is blurred: 4 px of smear halve it, key frames have 1.6 times."""
    farthest_s: float = 0.5
    """Where the window holds no undamaged picture, the nearest one this far from the trigger is taken, but no other."""
    patience_s: float = 3.0
    """How long a trigger waits for a picture of its time to arrive: slow Wi-Fi holds a second back."""
    ring_s: float = 4.0
    """How long pictures are kept for triggers that come late: cameras tell up to three seconds after the shot."""
    ring_mb: int = 400
    """Most memory for them; 1080p at 30 pictures a second needs 370 MB for four seconds, 4K keeps one second."""
    jpeg_quality: int = 95
    """Of the frames that are taken, 0 to 100; above 95 a video's own losses are far larger."""
    open_timeout_s: float = 5.0
    """Longest wait for the camera to answer."""
    read_timeout_s: float = 3.0
    """A stream that brings nothing for so long is closed and opened again."""
    gap_s: float = 1.0
    """A pause this long between two pictures is said aloud and counted, and all times are learnt anew."""
    reconnect_first_s: float = 0.25
    """Wait before a lost stream is opened again; it doubles with each failure."""
    reconnect_longest_s: float = 1.0
    """Longest such wait: an attempt costs nothing, and a camera that is back should be seen within two seconds."""
    allowed_hosts: tuple[str, ...] = ()
    """Hosts or networks (10.0.0.7, camera.local, 192.168.1.0/24) that `rtsp: auto` may be sent to by the aircraft."""

    def __post_init__(self) -> None:
        if self.every is not None:
            parse_every(self.every)
