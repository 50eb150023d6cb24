"""Flies a film: triggers on time, pictures a little later, telemetry throughout."""

from __future__ import annotations

import time
from collections.abc import Callable

from .delivery import Delivery
from .exposures import Exposure, Film
from .messages import Capture
from .stream.projector import Projector
from .vehicle import Vehicle

BREATH = 0.05  # seconds; polling interval
FIRST_INDEX = 1  # cameras count from 1

Say = Callable[[Exposure], None]


def fly(
    film: Film, vehicle: Vehicle, delivery: Delivery | Projector, speed: float = 1.0, said: Say | None = None
) -> None:
    """Fly to the end and wait for the last picture to arrive. A picture that is not ready in time delays all later ones,
    so that intervals are kept on a slow machine too. said: called after every trigger."""
    began = time.monotonic() + delivery.lead
    try:
        for exposure in film.exposures():
            delivery.expect(exposure.data, began + exposure.time / speed)
            began = wait_until(began, exposure, vehicle, speed)
            vehicle.capture(Capture(index=FIRST_INDEX + exposure.index, name=exposure.name, state=exposure.state))
            delivery.send(exposure.name, exposure.data)
            if said:
                said(exposure)
        delivery.finish()
    except BaseException:
        delivery.abandon()
        raise


def wait_until(began: float, exposure: Exposure, vehicle: Vehicle, speed: float) -> float:
    """Tick until the exposure is due; returns the flight's start time, shifted by any lateness."""
    due = began + exposure.time / speed
    late = time.monotonic() - due
    vehicle.tick(exposure.state)
    while (left := due - time.monotonic()) > 0:
        time.sleep(min(left, BREATH))
        vehicle.tick(exposure.state)
    return began + max(0.0, late)
