"""All looks at a place beside each other: what each frame shows of it, in the map's orientation and at one scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
from aiohttp import web

from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.coverage import Grid
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import QUALITY, NoPicture
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import SLOW_POOL, VIEW, in_thread, missing
from gcs_mosaic.web.api.frames import ISLAND, NO_PICTURE, PlaceQuery
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.tile_answer import tagged

OPERATIONS = Operations()
MOST_CELLS = 800  # px of a crop's side


@dataclass(frozen=True, slots=True, kw_only=True)
class LookCropQuery(PlaceQuery):
    """A square about a place on an island's canvas."""

    side: Annotated[float, Limits(least=0.01, most=1e6), "canvas units"]
    cells: Annotated[int, Limits(least=16, most=MOST_CELLS), "px of the picture's side"] = 320


@OPERATIONS.add(
    "GET",
    f"{ISLAND}/looks/{{frame:[0-9]{{1,9}}}}.jpg",
    Reply("The picture; dark grey where the frame does not see the ground.", Media(("image/jpeg",)), tagged=True),
    query=LookCropQuery,
    failures=NO_PICTURE,
)
async def look(request: web.Request) -> web.StreamResponse:
    """What a frame shows of a square of the ground, laid on the map's plane: all frames' in one orientation and scale."""
    asked, island = asked_query(request, LookCropQuery), int(request.match_info["island"])
    frame = int(request.match_info["frame"])
    try:
        data = await in_thread(request, _look, request.app[VIEW], frame, island, asked, pool=SLOW_POOL)
    except NoPicture as error:
        raise missing(str(error)) from error
    return tagged(request, data, "image/jpeg")


def _look(view: FlightView, frame: int, island: int, asked: LookCropQuery) -> bytes:
    """A JPEG. Raises NoPicture."""
    from gcs_mosaic.views.ground_window import aligned_look  # it loads what decodes

    window = Grid.about(asked.x, asked.y, asked.side, asked.cells)
    done, data = cv2.imencode(".jpg", aligned_look(view, frame, island, window), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise NoPicture("This look cannot be encoded.")
    return data.tobytes()
