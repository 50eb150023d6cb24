"""Settings of a live stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.frames.rtsp.interval import parse_every


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings:
    """How a live stream is received, and which of its images are taken. Times are in seconds."""

    transport: Literal["tcp", "udp"] = "tcp"
    """With "udp" a poor link loses images instead of time; damaged images are never taken."""
    every: str | None = None
    """Frames without triggers: "1 s" takes one per second, "overlap" one whenever the view has moved; none = triggers only."""
    moved: float = 0.3
    """Share of the image that must be new before "overlap" takes a frame: 70 % overlap is usual in mapping flights."""
    latency_s: float = 0.15
    """Minimum latency from capture to arrival; used if the camera sends no credible time."""
    window_s: float = 0.15
    """An image this close to the trigger may be taken instead of the nearest, if that one is blurred or damaged."""
    sharp_enough: float = 0.5
    """Below this share of the sharpest image's energy, an image is blurred: 4 px of smear halve it, key frames have 1.6 times."""
    farthest_s: float = 0.5
    """If the window has no undamaged image, the nearest one within this distance of the trigger is taken, but no other."""
    patience_s: float = 3.0
    """How long a trigger waits for an image of its time to arrive: slow Wi-Fi delays by a second."""
    ring_s: float = 4.0
    """How long images are kept for late triggers: cameras report up to three seconds after the shot."""
    ring_mb: int = 400
    """Memory limit for them; 1080p at 30 images a second needs 370 MB for four seconds, 4K keeps one second."""
    jpeg_quality: int = 95
    """JPEG quality of the frames taken, 0 to 100; above 95 the video's own losses are far larger."""
    open_timeout_s: float = 5.0
    """Timeout for the camera to answer."""
    read_timeout_s: float = 3.0
    """A stream silent for this long is closed and reopened."""
    gap_s: float = 1.0
    """A gap this long between two images is reported and counted, and all clock estimates are reset."""
    reconnect_first_s: float = 0.25
    """Wait before reopening a lost stream; doubles with each failure."""
    reconnect_longest_s: float = 1.0
    """Maximum of that wait: an attempt costs nothing, and a returning camera should be seen within two seconds."""
    allowed_hosts: tuple[str, ...] = ()
    """Hosts or networks (10.0.0.7, camera.local, 192.168.1.0/24) that the aircraft may announce, or a camera redirect to."""

    def __post_init__(self) -> None:
        if self.every is not None:
            parse_every(self.every)
