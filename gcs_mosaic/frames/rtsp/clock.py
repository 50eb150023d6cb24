"""Capture times of stream images on the host's monotonic clock. Pure; all times are arguments, in seconds."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

DRIFT = 1e-4  # seconds per second; quartz is accurate to 20-50 ppm
SETTLED_S = 0.5  # cameras first send buffered images in a burst; after that, arrivals are a reliable clock
_REPORTS = 15  # of the camera's own times: a single one may be off by one image interval
_FEWEST_REPORTS = 3
_STEP_S = 2.0  # by which no arrival is later than another: one of the clocks was set in between
# A camera with a set clock appears slightly late. One with an unset clock is off by years, or at least minutes.
_BELIEVED_S = (-0.02, 1.0)


class CaptureClock:
    """Tracks one connection without pauses. Image timestamps have an arbitrary epoch but a steady rate.

    Delays only add: the smallest difference between arrival and image time is the fastest path (the clock filter of
    network time synchronisation: Mills, RFC 5905). If the camera sends the time of day (RTCP sender
    reports, RFC 3550) and its clock agrees with the host's, that gives the capture time itself.
    """

    def __init__(self, began: float, latency_s: float) -> None:
        self._began, self._latency_s = began, latency_s
        self._offset = math.inf  # minimum of arrival minus image time
        self._updated = began
        self._camera: deque[float] = deque(maxlen=_REPORTS)  # camera's time of day minus image time
        self._latenesses: deque[float] = deque(maxlen=_REPORTS)  # arrival minus capture, by the two clocks
        self._monotonic_minus_utc = 0.0

    def note(self, picture_s: float, arrival: float, arrival_utc: float, camera_utc: float | None = None) -> None:
        """Add an arrived image; `camera_utc` is the capture time according to the camera (seconds since 1970)."""
        self._offset += DRIFT * max(0.0, arrival - self._updated)
        self._offset = min(self._offset, arrival - picture_s)
        self._updated = arrival
        if camera_utc is not None:
            self._monotonic_minus_utc = arrival - arrival_utc
            self._camera.append(camera_utc - picture_s)
            lateness = arrival_utc - camera_utc
            if self._latenesses and abs(lateness - self._latenesses[-1]) > _STEP_S:  # one of the clocks was set
                self._latenesses.clear()
                self._camera.clear()
                self._camera.append(camera_utc - picture_s)
            self._latenesses.append(lateness)

    def moment(self, picture_s: float) -> float:
        """The best current estimate of the image's capture time."""
        if self.believes_the_camera:
            return picture_s + median(self._camera) + self._monotonic_minus_utc
        return picture_s + self._offset - self._latency_s

    @property
    def believes_the_camera(self) -> bool:
        """Whether the camera sends the time of day, and its clock is set."""
        low, high = _BELIEVED_S
        return len(self._camera) >= _FEWEST_REPORTS and low <= min(self._latenesses) <= high

    def is_settled(self, now: float) -> bool:
        """Whether the estimates are reliable."""
        return now - self._began >= SETTLED_S
