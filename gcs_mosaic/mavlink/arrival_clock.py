"""Kernel receive times (UTC) on the host's monotonic clock, even if UTC is set meanwhile. Pure; both clocks are passed in.

What waited in the kernel while the program stood still (a suspended laptop, SIGSTOP) is dated by its arrival.
"""

from __future__ import annotations

_LATE_S = 0.05  # two readings of both clocks are this far apart at most, unless UTC was set
_EARLY_S = 0.05  # tolerated before the last reading: a datagram may arrive while the socket is being emptied


class ArrivalClock:
    """Converts receive times. UTC at the monotonic clock's zero changes when the clock is set, and by a suspension, in which
    the monotonic clock stands still; a datagram read after such a change may have arrived before it."""

    def __init__(self, monotonic: float, utc: float) -> None:
        """Both clocks, read together."""
        self._emptied = monotonic  # when the socket was last found empty
        self._utc_of_zero = self._before = utc - monotonic

    def read_at(self, monotonic: float, utc: float) -> None:
        """Both clocks, read together, before a batch of datagrams is converted."""
        now = utc - monotonic
        if abs(now - self._utc_of_zero) > _LATE_S:
            self._before = self._utc_of_zero
        self._utc_of_zero = now

    def arrived(self, stamp_utc: float, monotonic: float) -> float:
        """When a datagram with this receive time, read at `monotonic`, arrived; `monotonic` itself if that is impossible."""
        for utc_of_zero in (self._utc_of_zero, self._before):
            moment = stamp_utc - utc_of_zero
            if self._emptied - _EARLY_S <= moment <= monotonic + _LATE_S:
                return min(moment, monotonic)
        return monotonic

    def emptied(self, monotonic: float) -> None:
        """Nothing was left to be read at `monotonic`: what is read later arrives later. Both offsets are the newest one."""
        self._emptied = monotonic
        self._before = self._utc_of_zero
