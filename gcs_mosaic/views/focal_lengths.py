"""How far the focal length of frames is known: heights in metres are as uncertain."""

from __future__ import annotations

import math
from collections.abc import Collection
from statistics import median

from gcs_mosaic.views.flight_view import FlightView


def focal_deviation(view: FlightView, names: Collection[str]) -> float | None:
    """The median stated deviation of the log of some frames' focal lengths; None if any usual one was not estimated. Raises
    UsageError."""
    with view.ledger() as ledger:
        told = [one.focal_log_deviation for one in ledger.estimates() if one.name in names]
    usual = median([math.inf if one is None else one for one in told] or [math.inf])
    return None if math.isinf(usual) else usual
