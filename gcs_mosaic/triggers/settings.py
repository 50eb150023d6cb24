"""Settings of the pairing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PairingSettings:
    """How events are matched with frames. Times are in seconds."""

    missing_after_s: float = 60.0
    """After this an event without a frame is missing: slow links need half a minute per picture."""
    window_s: float = 15.0
    """Matching by time alone: a frame arrives at most this long after its event."""
    early_s: float = 2.0
    """... and at most this long before it: messages are late too."""
    spread_s: float = 4.0
    """... and deviates at most this much from the usual delay, once that is known."""
    remembered: int = 5000
    """Events and frames kept for matching; the oldest are given up, as missing and as orphans."""
