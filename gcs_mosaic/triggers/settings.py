"""The settings of the pairing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PairingSettings:
    """How events find their frames. Times are in seconds."""

    missing_after_s: float = 60.0
    """An event whose frame has not come by then is said to be missing: slow links take half a minute a picture."""
    window_s: float = 15.0
    """A frame that nothing but its time connects to an event comes at most so long after it."""
    early_s: float = 2.0
    """... and at most so long before: messages are late too."""
    spread_s: float = 4.0
    """... and this far at most from the usual delay, once that is known."""
    remembered: int = 5000
    """Events and frames that can still find each other; the oldest are given up, as missing and as orphans."""
