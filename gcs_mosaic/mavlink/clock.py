"""Infers the epoch of a remote clock from its timestamps. Pure."""

from __future__ import annotations

from typing import Literal

Clock = Literal["boot", "epoch", "none"]

EPOCH_FROM_S = 1e9  # 2001 in seconds since 1970, or 31 years of uptime
SANE_UTC_S = (1.4e9, 4.1e9)  # 2014 to 2099; real logs contain the year 2908, and 1970 without a GPS fix


def clock_of(seconds: float) -> Clock:
    """What a timestamp counts from, judged by its magnitude; zero or negative means that the sender did not know."""
    if not seconds > 0:
        return "none"
    return "epoch" if seconds >= EPOCH_FROM_S else "boot"


def plausible_utc(seconds: float) -> float | None:
    """`seconds` since 1970 if within the plausible range, else None."""
    return seconds if SANE_UTC_S[0] <= seconds <= SANE_UTC_S[1] else None
