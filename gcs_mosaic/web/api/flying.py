"""How to fly on for a wanted number of looks at each place, as this flight's camera sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import BASE, SLOW_POOL, VIEW, answer, in_thread
from gcs_mosaic.web.api.operations import NO_NOTES, Operations, Reply
from gcs_mosaic.web.api.scale import scales_of

OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyingQuery:
    """What is wanted."""

    looks: Annotated[int, Limits(least=2, most=100), "at each place"]
    at: Annotated[float, Limits(least=0.1, most=4), "height, in heights of the flight"] = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyingAnswer:
    """What to fly, whichever way the camera is turned: by the shorter side of its frames. Lengths are null where no scale is
    known, the speed where nothing tells how often the camera takes a picture."""

    looks: Annotated[int, Limits(least=2), "that this gives: a whole number along by a whole number across"]
    forward: Annotated[float, "overlap of two frames of a line, as a share"]
    side: Annotated[float, "overlap of two lines, as a share"]
    step_m: Annotated[float | None, "between two frames"]
    spacing_m: Annotated[float | None, "between two lines"]
    gsd_m: Annotated[float | None, "of a pixel on the ground"]
    interval_s: Annotated[float | None, "between two frames, as this flight took them"]
    speed_m_s: Annotated[float | None, "at most, for that interval"]
    speed_share: Annotated[float | None, "at most, of a frame's shorter side each second"]


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/flying",
    Reply("The overlaps, the way between frames and lines, and the speed.", FlyingAnswer),
    query=FlyingQuery,
    failures={409: "There is no frame on that island.", **NO_NOTES},
)
async def flying(request: web.Request) -> web.StreamResponse:
    """How to fly for so many looks at each place, to look through trees."""
    asked, island = asked_query(request, FlyingQuery), int(request.match_info["island"])
    scale = (await scales_of(request)).get(island)
    per_unit = None if scale is None else scale.metres_per_unit
    try:
        return answer(await in_thread(request, _told, request.app[VIEW], island, asked, per_unit, pool=SLOW_POOL))
    except UsageError as error:
        raise web.HTTPConflict(text=f"{error}\n") from error


def _told(view: FlightView, island: int, asked: FlyingQuery, per_unit: float | None) -> FlyingAnswer:
    from gcs_mosaic.handover.survey import survey_of
    from gcs_mosaic.integral.how_to_fly import pattern_for

    survey, pattern, interval = (
        survey_of(view, island, per_unit or 1.0),
        pattern_for(asked.looks),
        _interval(view, island),
    )
    side = None if per_unit is None else survey.side_m * asked.at
    step = 1 - pattern.forward
    return FlyingAnswer(
        looks=pattern.looks,
        forward=round(pattern.forward, 4),
        side=round(pattern.side, 4),
        step_m=None if side is None else round(side * step, 2),
        spacing_m=None if side is None else round(side * (1 - pattern.side), 2),
        gsd_m=None if per_unit is None else round(survey.gsd_m * asked.at, 5),
        interval_s=None if interval is None else round(interval, 2),
        speed_m_s=None if side is None or interval is None else round(side * step / interval, 2),
        speed_share=None if interval is None else round(step / interval, 4),
    )


def _interval(view: FlightView, island: int) -> float | None:
    """Between consecutive frames of one aircraft: the middle one, which pauses and turns do not move."""
    table = view.table()
    taken, ways = view.taken(table), list[float]()
    its = [index for index, one in enumerate(table.islands.tolist()) if one == island]
    for vehicle in {table.frames[index].vehicle for index in its}:
        times = np.sort([taken[index] for index in its if table.frames[index].vehicle == vehicle])
        ways += [one for one in np.diff(times).tolist() if math.isfinite(one) and one > 0]
    return float(np.median(ways)) if ways else None
