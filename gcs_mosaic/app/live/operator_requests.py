"""Answers what the operator asks of a running flight by `gcs-mosaic vehicle`."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import Notice
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.requests import Answer, FollowRequest, answer, clear_requests, take_request

logger = logging.getLogger(__name__)

POLL_S = 1.0


class OperatorRequests:
    """Looks about once a second for a request in the flight's folder. A disk that fails never stops the flight."""

    def __init__(self, flight: Path, choice: VehicleChoice, say: Callable[[Notice], None]) -> None:
        self._flight, self._choice, self._say = flight, choice, say
        self._next = 0.0
        try:
            clear_requests(flight)
        except OSError:
            logger.warning("requests of an earlier run cannot be removed", exc_info=True)

    def look(self, now: float) -> None:
        """Answer a request if it is time to look, at `now` (monotonic seconds)."""
        if now < self._next:
            return
        self._next = now + POLL_S
        try:
            request = take_request(self._flight)
            if isinstance(request, str):
                self._say(Notice(source="requests", level="warning", text=f"a request is left out: {request}"))
            elif request is not None:
                answer(self._flight, self._follow(request))
        except (OSError, DiskFull):
            logger.debug("requests cannot be read or answered", exc_info=True)

    def _follow(self, request: FollowRequest) -> Answer:
        before, taken = self._choice.followed, self._choice.choose(request.vehicle)
        if self._choice.is_of_several:
            named = ", ".join(map(str, self._choice.counted)) or "all, of which none has triggered yet"
            text = f"this flight is of several aircraft ({named}), whose triggers all count, so nothing was changed"
        elif not taken:
            heard = ", ".join(map(str, self._choice.systems())) or "none"
            text = f"system {request.vehicle} has not been heard (heard: {heard}), so nothing was changed"
        elif before == request.vehicle:
            text = f"system {request.vehicle} is followed already, and stays so"
        else:
            text = f"system {request.vehicle} is followed from now on"
        return Answer(id=request.id, taken=taken, text=text)
