"""Which ground was looked at, and by whom."""

from __future__ import annotations

from typing import Any

from aiohttp import web

from gcs_mosaic.notes.checked import FURTHEST, LONGEST_NAME, Unfit, number_of, text_of, whole_of
from gcs_mosaic.notes.reviews import CELL, CELL_LEVEL, LONGEST_LOOK_S, Question, ReviewedView, seen_cells
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Box
from gcs_mosaic.web.api.common import BASE, VIEW, body_of, in_thread
from gcs_mosaic.web.api.notes import NOTES, asked_island, asked_number, island_of, reading, told_anew, who_of, writing

PATH = f"{BASE}/reviews"
EDGES = ("left", "top", "right", "bottom")


def add_routes(app: web.Application) -> None:
    app.router.add_get(PATH, reading(covered))
    app.router.add_post(PATH, writing(report))


async def report(request: web.Request) -> web.StreamResponse:
    """POST: what somebody had on the screen for some seconds; 202, as it is written some seconds later."""
    told, notes = await body_of(request), request.app[NOTES]
    look = ReviewedView(
        island=island_of(told.get("island")),
        box=_box(told.get("box")),
        level=whole_of(told.get("level"), "level", 0, FINEST_LEVEL),
        seconds=number_of(told.get("seconds"), "seconds", 0, LONGEST_LOOK_S),
        who=who_of(told.get("who")),
    )
    return web.json_response({"cells": await notes.run(notes.reviews.report, look)}, status=202)


async def covered(request: web.Request) -> web.StreamResponse:
    """GET: the cells of painted ground within a box, parted by whether they were reviewed as asked."""
    notes = request.app[NOTES]
    box = _box([asked_number(request, name, -FURTHEST, FURTHEST) for name in EDGES])
    question = Question(
        island=asked_island(request),
        box=box,
        level=int(asked_number(request, "level", 0, FINEST_LEVEL)),
        seconds=asked_number(request, "seconds", 0, 1e6) if "seconds" in request.query else 0.0,
        who=text_of(request.query.get("who"), "who", LONGEST_NAME) or None,
        since_utc=asked_number(request, "since", 0, 1e11) if "since" in request.query else 0.0,
    )
    table = await in_thread(request, request.app[VIEW].table)
    seen = await in_thread(request, seen_cells, table, question.island, box)
    reviewed, reviewers = await notes.run(lambda: (notes.reviews.reviewed(question), dict(notes.reviews.reviewers())))
    document = {
        "cell": {"units": CELL, "level": CELL_LEVEL},
        "reviewed": sorted(seen & reviewed),
        "missing": sorted(seen - reviewed),
        "reviewers": [{"who": who, "utc": utc} for who, utc in sorted(reviewers.items())],
    }
    return told_anew(request, document)


def _box(told: Any) -> Box:
    if not isinstance(told, list) or len(told) != len(EDGES):
        raise Unfit("box is to be left, top, right, bottom.")
    left, top, right, bottom = (number_of(edge, "box", -FURTHEST, FURTHEST) for edge in told)
    if left >= right or top >= bottom:
        raise Unfit("box is to be left, top, right, bottom.")
    return left, top, right, bottom
