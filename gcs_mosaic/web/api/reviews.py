"""Which ground was looked at, and by whom."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from aiohttp import web

from gcs_mosaic.notes.search.reviews import LONGEST_LOOK_S, MOST_CELLS, Question, ReviewedView, cells_within
from gcs_mosaic.notes.search.seen_ground import CELL, CELL_LEVEL, seen_cells
from gcs_mosaic.notes.storage.checked import LONGEST_NAME, Unfit, Utc, Who
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Box
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.asked import asked_body, asked_query
from gcs_mosaic.web.api.common import BASE, SHOWN_S, VIEW, MapRevision, answer, in_thread, told_anew
from gcs_mosaic.web.api.notes import NOTES, Canvas, IslandNumber
from gcs_mosaic.web.api.operations import NO_NOTES, Operations, Reply

PATH = f"{BASE}/reviews"
Level = Annotated[int, Limits(least=0, most=FINEST_LEVEL)]
Cells = Annotated[Sequence[tuple[int, int]], "x, y of tiles of the cells' level"]
OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class LookBody:
    """What was on somebody's screen."""

    island: IslandNumber
    box: Annotated[tuple[Canvas, Canvas, Canvas, Canvas], "left, top, right, bottom, on the island's canvas"]
    level: Annotated[Level, "zoom"]
    seconds: Annotated[float, Limits(least=0, most=LONGEST_LOOK_S)]
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class CellsAnswer:
    """What counts of it."""

    cells: Annotated[int, "that it covers; 0 from too far away"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewedQuery:
    """A box of an island, and what counts as reviewed."""

    island: IslandNumber
    left: Annotated[Canvas, "on the island's canvas"]
    top: Canvas
    right: Canvas
    bottom: Canvas
    level: Annotated[Level, "this zoom or finer"]
    seconds: Annotated[float, Limits(least=0, most=1e6), "so long in sum"] = 0.0
    who: Annotated[str, Limits(longest=LONGEST_NAME), "by this person alone"] = ""
    since: Annotated[float, Limits(least=0, most=1e11), "seconds since 1970"] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewCell:
    """What is counted: the tiles of a level."""

    units: Annotated[float, "canvas units, of a side"]
    level: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Reviewer:
    """Who has looked, and when last."""

    who: Who
    utc: Utc


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewedAnswer:
    """The cells of painted ground within a box."""

    map_revision: MapRevision
    cell: ReviewCell
    reviewed: Cells
    missing: Cells
    reviewers: Sequence[Reviewer]


@OPERATIONS.add(
    "POST",
    PATH,
    Reply("CaptureTime in; on the disk some seconds later.", CellsAnswer, 202),
    body=LookBody,
    failures=NO_NOTES,
)
async def report(request: web.Request) -> web.StreamResponse:
    """Report what was on the screen."""
    asked, notes = await asked_body(request, LookBody), request.app[NOTES]
    stamps = await in_thread(request, _shown, request.app[VIEW], asked)
    look = ReviewedView(
        island=asked.island,
        box=_box(asked.box),
        level=asked.level,
        seconds=asked.seconds,
        who=asked.who,
        stamps=stamps,
    )
    return answer(CellsAnswer(cells=await notes.run(notes.reviews.report, look)), 202)


@OPERATIONS.add("GET", PATH, Reply("The cells.", ReviewedAnswer, tagged=True), query=ReviewedQuery, failures=NO_NOTES)
async def covered(request: web.Request) -> web.StreamResponse:
    """The cells of painted ground within a box, parted by whether they were reviewed as asked since a frame was painted there."""
    notes, asked = request.app[NOTES], asked_query(request, ReviewedQuery)
    question = Question(
        island=asked.island,
        box=_box((asked.left, asked.top, asked.right, asked.bottom)),
        level=asked.level,
        seconds=asked.seconds,
        who=asked.who or None,
        since_utc=asked.since,
    )
    table = await in_thread(request, request.app[VIEW].table)
    seen = await in_thread(request, seen_cells, table, question.island, question.box)
    known, reviewers = await notes.run(
        lambda: (notes.reviews.reviewed(question, seen), dict(notes.reviews.reviewers()))
    )
    reviewed = known & seen.keys()
    told = ReviewedAnswer(
        map_revision=table.revision,
        cell=ReviewCell(units=CELL, level=CELL_LEVEL),
        reviewed=sorted(reviewed),
        missing=sorted(set(seen) - reviewed),
        reviewers=[Reviewer(who=who, utc=utc) for who, utc in sorted(reviewers.items())],
    )
    return told_anew(request, told)


def _shown(view: FlightView, asked: LookBody) -> dict[tuple[int, int], int]:
    """What was on the map for as long as was looked: what was painted meanwhile may not have been seen."""
    box = _box(asked.box)
    if len(cells_within(box)) > MOST_CELLS:  # counts for nothing
        return {}
    return seen_cells(view.table(), asked.island, box, time.monotonic() - max(SHOWN_S, asked.seconds))


def _box(edges: Box) -> Box:
    """Raises Unfit."""
    left, top, right, bottom = edges
    if left >= right or top >= bottom:
        raise Unfit("box is to be left, top, right, bottom.")
    return edges
