"""When a picture was taken, on the host's monotonic clock. Pure; all times come as arguments, in seconds."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

DRIFT = 1e-4  # seconds per second; quartz is good to 20-50 ppm
SETTLED_S = 0.5  # cameras send what they had in store first, all at once; after that arrivals tell the time
_REPORTS = 15  # of the camera's own times: single ones are a picture off
_FEWEST_REPORTS = 3
# A camera whose clock is set is seen to be a little late. One whose clock is not set is years, or at least minutes off.
_BELIEVED_S = (-0.02, 1.0)


class CaptureClock:
    """Follows one connection without a pause in it. A picture's own time counts from anywhere, but evenly.

    Delays only add: the smallest distance between the pictures' times and their arrivals is the fastest way (the
    method of network clocks: Mills, RFC 5905, the clock filter). Where the camera tells the time of day (RTCP sender
    reports, RFC 3550) and its clock is set as the host's is, that is the time of capture itself.
    """

    def __init__(self, began: float, latency_s: float) -> None:
        self._began, self._latency_s = began, latency_s
        self._offset = math.inf  # arrival minus picture time, at the fastest
        self._updated = began
        self._camera: deque[float] = deque(maxlen=_REPORTS)  # camera's time of day minus picture time
        self._lateness = math.inf  # arrival minus capture, by the two clocks, at the least
        self._monotonic_minus_utc = 0.0

    def note(self, picture_s: float, arrival: float, arrival_utc: float, camera_utc: float | None = None) -> None:
        """A picture has arrived; `camera_utc` is when the camera says that it was taken (seconds since 1970)."""
        self._offset += DRIFT * max(0.0, arrival - self._updated)
        self._offset = min(self._offset, arrival - picture_s)
        self._updated = arrival
        if camera_utc is not None:
            self._monotonic_minus_utc = arrival - arrival_utc
            self._camera.append(camera_utc - picture_s)
            self._lateness = min(self._lateness, arrival_utc - camera_utc)

    def moment(self, picture_s: float) -> float:
        """When the picture was taken, as far as is known by now."""
        if self.believes_the_camera:
            return picture_s + median(self._camera) + self._monotonic_minus_utc
        return picture_s + self._offset - self._latency_s

    @property
    def believes_the_camera(self) -> bool:
        """Whether the camera tells the time of day, and its clock is set."""
        low, high = _BELIEVED_S
        return len(self._camera) >= _FEWEST_REPORTS and low <= self._lateness <= high

    def is_settled(self, now: float) -> bool:
        """Whether moments can be relied on."""
        return now - self._began >= SETTLED_S
