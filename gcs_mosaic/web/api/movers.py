"""Movers: tracks of what changes place between consecutive looks. Hints, and never a filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from aiohttp import web

from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.common import SLOW_POOL, VIEW, MapRevision, answer, in_thread
from gcs_mosaic.web.api.frames import ISLAND, TimeBy, When, shown_name
from gcs_mosaic.web.api.operations import Operations, Reply

if TYPE_CHECKING:
    from gcs_mosaic.hints.mover_tracks import SeenBlob
    from gcs_mosaic.hints.movers import MoverSearch
    from gcs_mosaic.store.records import PositionRecord
    from gcs_mosaic.views.taken import CaptureTime

OPERATIONS = Operations()
SEARCH = web.AppKey("mover_search", list)  # of one, once somebody has asked
MOST_TRACKS = 200  # in an answer, the longest
Count = Annotated[int, Limits(least=0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class MoverLookAnswer:
    """A thing that moves in one frame."""

    frame: Annotated[int, "number of the frame"]
    name: str
    pixel: Annotated[tuple[float, float], "of the original"]
    x: Annotated[float, "on the island's canvas"]
    y: float
    time: When
    time_by: TimeBy


@dataclass(frozen=True, slots=True, kw_only=True)
class MoverAnswer:
    """A track, in order of time."""

    size: Annotated[float, "side of the square of the thing's area, canvas units"]
    looks: Sequence[MoverLookAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class MoversAnswer:
    """What may move there. Never all of it: only what stands out in three looks one after another at least."""

    map_revision: MapRevision
    searched: Annotated[Count, "frames; a question has further ones searched, for a second"]
    frames: Count
    movers: Sequence[MoverAnswer]


@OPERATIONS.add("GET", f"{ISLAND}/movers", Reply("What is known so far.", MoversAnswer))
async def movers(request: web.Request) -> web.StreamResponse:
    """Things of an island that change place from look to look; each question has some more frames searched."""
    island = int(request.match_info["island"])
    return answer(await in_thread(request, _movers, _search(request.app), request.app[VIEW], island, pool=SLOW_POOL))


def keep_search(app: web.Application) -> None:
    """For requests to come."""
    app[SEARCH] = []


def _search(app: web.Application) -> MoverSearch:
    from gcs_mosaic.hints.movers import MoverSearch  # it loads what decodes

    if not app[SEARCH]:
        app[SEARCH].append(MoverSearch(app[VIEW]))
    search: MoverSearch = app[SEARCH][0]
    return search


def _movers(search: MoverSearch, view: FlightView, island: int) -> MoversAnswer:
    found = search.ask(island)
    table = view.table()
    frames = {one.number: one for one in table.frames}
    times = view.capture_times(table) if found.tracks else {}
    movers = []
    for track in found.tracks[:MOST_TRACKS]:
        known = [(one, frames[one.frame]) for one in track if one.frame in frames]
        looks = [_look(one, frame, times.get(one.frame)) for one, frame in known]
        movers.append(MoverAnswer(size=round(max(one.size for one in track), 1), looks=looks))
    return MoversAnswer(map_revision=found.revision, searched=found.searched, frames=found.frames, movers=movers)


def _look(one: SeenBlob, frame: PositionRecord, taken: CaptureTime | None) -> MoverLookAnswer:
    return MoverLookAnswer(
        frame=one.frame,
        name=shown_name(frame.name),
        pixel=(round(one.pixel[0], 1), round(one.pixel[1], 1)),
        x=round(one.x, 2),
        y=round(one.y, 2),
        time=None if taken is None else taken.iso(),
        time_by=None if taken is None else taken.by,
    )
