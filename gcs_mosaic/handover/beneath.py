"""What lies beneath the leaves at a find: all looks at it laid together, in focus at the ground, for a report."""

from __future__ import annotations

import logging

from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral.lens_keeper import LensKeeper, LensWish, as_jpeg
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.finds.report import CROP, Beneath
from gcs_mosaic.views.flight_view import FlightView

logger = logging.getLogger(__name__)

BESIDE_S = 1.0  # for each find that the ground is sought around it: somebody waits for all of the report


class BeneathLeaves:
    """Of the finds of a flight."""

    def __init__(self, view: FlightView) -> None:
        self._keeper = LensKeeper(view, BESIDE_S)

    def __call__(self, one: PlacedFind) -> Beneath | None:
        """None where fewer than two looks at it can be laid together."""
        try:
            seen = self._keeper.look(LensWish(island=one.place.island, x=one.place.x, y=one.place.y, cells=CROP))
        except UsageError as error:
            logger.info("find %d is shown without an integral: %s", one.find.id, error)
            return None
        how = "in focus at the ground" if seen.focus.known else "the ground's height is not known, the focus is a guess"
        if seen.focus.beside:
            how = "in focus at the height of the ground around it"
        return Beneath(as_jpeg(seen, "mean"), f"{seen.aperture.looks} looks laid together, {how}")
