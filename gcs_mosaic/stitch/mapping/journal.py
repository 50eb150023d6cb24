"""Logs why frames lie where they lie: refusals with their figures, and in detail what was accepted."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from gcs_mosaic.stitch.graph.observer import Residuals
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration

logger = logging.getLogger(__name__)


class Journal:
    """An observer that logs its notifications: refusals at level info, the rest at level debug."""

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        if isinstance(found, Registration):
            numbers = found.independent_inliers, found.evidence
            logger.debug("%s and %s agree: %d independent inliers, evidence %.1f", a, b, *numbers)
        else:
            logger.info("%s and %s are not connected: %s; %d inliers", a, b, found.reason, found.inliers)

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        logger.info("%s is not placed beside %s: %s", name, beside, reason)

    def placed(self, placement: Placement) -> None:
        numbers = placement.inliers, len(placement.neighbours), placement.residual_px
        where = placement.name, placement.island
        logger.debug("%s lies on island %d: %d inliers with %d frames, %.2f px off", *where, *numbers)

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        logger.debug("island %d is adjusted", island)
