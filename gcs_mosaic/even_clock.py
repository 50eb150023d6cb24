"""UTC that goes on evenly while a flight lasts. The computer's own clock may be set meanwhile, by hours where a laptop finds its
time by GPS or network: what lasts would then end or never begin, and ages would be off by as much."""

from __future__ import annotations

import time

_SET_S = 1.0  # by which the clock has been set, and not only drifted


def _elapsed() -> float:
    """Seconds that go on while the computer is suspended, where it tells of such (Linux)."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


_UTC_OF_ZERO = time.time() - _elapsed()


def even_utc() -> float:
    """Seconds since 1970 by the clock as it was when this process began, however it has been set since."""
    return _UTC_OF_ZERO + _elapsed()


def even_utc_of_zero() -> float:
    """That at the monotonic clock's zero: it moves by the time for which the computer was suspended, as far as that clock stands
    still meanwhile."""
    return even_utc() - time.monotonic()


def as_set_now(utc: float | None) -> float | None:
    """A moment of `even_utc` by the clock as it is set now, by which a reader reckons its age."""
    return None if utc is None else utc + set_by()


def made_even(utc: float | None) -> float | None:
    """A moment by the clock as it is set now, as `even_utc` has it."""
    return None if utc is None else utc - set_by()


def set_by() -> float:
    """Seconds by which the clock has been set since this process began; 0 while it has only drifted."""
    moved = time.time() - even_utc()
    return moved if abs(moved) > _SET_S else 0.0
