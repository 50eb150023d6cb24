"""Hints: what may be worth a look, and the colours that are sought."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Collection
from contextlib import suppress
from typing import Any

import numpy as np
from aiohttp import web

from gcs_mosaic.hints.hint_file import read_hints
from gcs_mosaic.hints.hint_places import hint_places
from gcs_mosaic.hints.ranking import RankedHint, ranked
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.notes.checked import FURTHEST, LONGEST_LABEL, Unfit, number_of, point_of, text_of, whole_of
from gcs_mosaic.notes.hint_wishes import PickedColour
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import NoPicture, displayed
from gcs_mosaic.views.sightings import sightings
from gcs_mosaic.web.api.common import BASE, VIEW, answer, body_of, in_thread
from gcs_mosaic.web.api.notes import NOTES, id_of, island_of, reading, told_anew, who_of, writing
from gcs_mosaic.web.hint_keeper import HintKeeper

PATH = f"{BASE}/hints"
COLOURS = f"{PATH}/colours"
ONE_COLOUR = COLOURS + r"/{id:[0-9]{1,9}}"
TOLERANCE, LEAST_TOLERANCE, MOST_TOLERANCE = 18.0, 2.0, 80.0
AROUND = 1  # px about the picked one, of which the median is taken
MOST_FRAME = 999_999_999
MOST_SHOWN = 500
WISHES_S = 2.0  # between looks at what other programs have written to the notes

SAME_S = 1.5  # for which an answer is the same for all pages
KEEPER = web.AppKey("hint_keeper", HintKeeper)


class ShownHints:
    """What is to be shown now, worked out once for all pages that ask. Thread-safe."""

    def __init__(self, view: FlightView, settings: HintSettings) -> None:
        self._view, self._settings = view, settings
        self._lock = threading.Lock()
        self._last: tuple[float, Collection[str], dict[str, Any]] = -SAME_S, (), {}

    def now(self, dismissed: Collection[str]) -> dict[str, Any]:
        with self._lock:
            then, without, told = self._last
            if time.monotonic() - then > SAME_S or without != dismissed:
                told = _shown(self._view, self._settings, dismissed)
                self._last = time.monotonic(), dismissed, told
            return told


SHOWN = web.AppKey("shown_hints", ShownHints)


def add_hints(app: web.Application, settings: HintSettings) -> None:
    """Seek hints as long as the application runs and somebody wants them."""
    app[SHOWN], app[KEEPER] = ShownHints(app[VIEW], settings), HintKeeper(app[VIEW].root, settings)
    app.cleanup_ctx.append(_kept)


def add_routes(app: web.Application) -> None:
    app.router.add_get(PATH, reading(every))
    app.router.add_post(PATH, writing(switch))
    app.router.add_post(COLOURS, writing(pick))
    app.router.add_delete(ONE_COLOUR, writing(take_away))


async def every(request: web.Request) -> web.StreamResponse:
    """GET: whether hints are sought and how far that has come, the hints where they lie now, the colours that are sought."""
    notes, keeper = request.app[NOTES], request.app[KEEPER]
    colours, dismissed = await notes.run(lambda: (notes.hint_wishes.colours(), notes.dismissed.all()))
    keys = {str(one["hint"]) for one in dismissed}
    head = {
        "on": keeper.is_asked,
        "state": keeper.state,
        "trouble": keeper.trouble,
        "colours": [_colour_document(one) for one in colours],
    }
    return told_anew(request, head | await in_thread(request, request.app[SHOWN].now, keys))


async def switch(request: web.Request) -> web.StreamResponse:
    """POST: seek hints or do not (on), for everybody."""
    told, notes = await body_of(request), request.app[NOTES]
    if not isinstance(told.get("on"), bool):
        raise Unfit("on is to be true or false.")
    asked, who = told["on"], who_of(told.get("who"))
    await notes.run(lambda: notes.hint_wishes.ask(who, asked=asked))
    await _pass_on(request.app)
    return answer({"on": asked})


async def pick(request: web.Request) -> web.StreamResponse:
    """POST: seek a colour: rgb (three numbers), or that of a place of the map (island, x, y) or of an original (frame, pixel)."""
    told, notes = await body_of(request), request.app[NOTES]
    label, who = text_of(told.get("label"), "label", LONGEST_LABEL), who_of(told.get("who"))
    tolerance = number_of(told.get("tolerance", TOLERANCE), "tolerance", LEAST_TOLERANCE, MOST_TOLERANCE)
    bgr = _given_colour(told) if "rgb" in told else await in_thread(request, _colour_at, request.app[VIEW], told)
    picked = await notes.run(notes.hint_wishes.pick, bgr, tolerance, label, who)
    await _pass_on(request.app)
    return web.json_response(_colour_document(picked), status=201)


async def take_away(request: web.Request) -> web.StreamResponse:
    """DELETE: seek a colour no more."""
    notes, number = request.app[NOTES], id_of(request)
    await notes.run(notes.hint_wishes.take_away, number)
    await _pass_on(request.app)
    return answer({"id": number})


async def _kept(app: web.Application) -> AsyncIterator[None]:
    app[KEEPER].start()
    task = asyncio.create_task(_pass_on_for_ever(app))
    yield
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    await asyncio.to_thread(app[KEEPER].stop)


async def _pass_on_for_ever(app: web.Application) -> None:
    while True:
        with suppress(web.HTTPServiceUnavailable):
            await _pass_on(app)
        await asyncio.sleep(WISHES_S)


async def _pass_on(app: web.Application) -> None:
    """What people want, to who keeps the process."""
    wishes = app[NOTES].hint_wishes
    app[KEEPER].wish(*await app[NOTES].run(lambda: (wishes.asked, wishes.colours())))


def _shown(view: FlightView, settings: HintSettings, dismissed: Collection[str]) -> dict[str, Any]:
    read, table = read_hints(view.root), view.table()
    times = [frame.modified for frame in table.frames if frame.modified is not None]
    minutes = (max(times) - min(times)) / 60 if times else 0.0
    places = hint_places(view, read.hints)
    shown = ranked(read, places, settings.per_minute, minutes, dismissed)[:MOST_SHOWN]
    names = {frame.number: frame.name for frame in table.frames}
    return {
        "searched": read.searched,
        "failed": read.failed,
        "frames": len(table.frames),
        "hints": [{"hint": read.key(one.hint), **_document(one, names)} for one in shown],
    }


def _document(one: RankedHint, names: dict[int, str]) -> dict[str, Any]:
    found, place = one.hint.found, one.place
    return {
        "reason": one.reason,
        "what": found.what,
        "worth": round(one.worth, 2),
        "utc": one.hint.utc,
        "island": None if place is None else place.island,
        "place": None if place is None else [round(place.x, 1), round(place.y, 1)],
        "frame": found.frame,
        "name": names.get(found.frame, "").encode("utf-8", "replace").decode(),
        "pixel": [round(found.x, 1), round(found.y, 1)],
        "size": [found.width, found.height],
        "seen": found.seen,
        "looks": found.verdict.looks,
    }


def _colour_document(one: PickedColour) -> dict[str, Any]:
    blue, green, red = one.bgr
    rest = {"tolerance": one.tolerance, "label": one.label, "who": one.who, "utc": one.utc}
    return {"id": one.id, "rgb": [red, green, blue], **rest}


def _given_colour(told: dict[str, Any]) -> tuple[int, int, int]:
    """Raises Unfit."""
    rgb = told["rgb"]
    if not isinstance(rgb, list) or len(rgb) != 3:
        raise Unfit("rgb is to be three whole numbers.")
    red, green, blue = (whole_of(value, "rgb", 0, 255) for value in rgb)
    return blue, green, red


def _colour_at(view: FlightView, told: dict[str, Any]) -> tuple[int, int, int]:
    """Of a place of the map, as the best look at it shows it, or of a pixel of an original. Raises Unfit."""
    if "frame" in told:
        frame = whole_of(told["frame"], "frame", 0, MOST_FRAME)
        x, y = point_of(told.get("pixel"), "pixel")
    else:
        island = island_of(told.get("island"))
        seen = sightings(view, island, *(number_of(told.get(name), name, -FURTHEST, FURTHEST) for name in ("x", "y")))
        if not seen:
            raise Unfit("No frame has seen that place.")
        frame, x, y = seen[0].number, seen[0].x, seen[0].y
    try:
        picture = displayed(view, frame, 1)
    except NoPicture as error:
        raise Unfit(str(error)) from error
    return _median_about(picture, round(x), round(y))


def _median_about(picture: np.ndarray[Any, Any], x: int, y: int) -> tuple[int, int, int]:
    """Raises Unfit for a pixel outside."""
    if not (0 <= x < picture.shape[1] and 0 <= y < picture.shape[0]):
        raise Unfit("pixel is to be inside the frame.")
    around = picture[max(0, y - AROUND) : y + AROUND + 1, max(0, x - AROUND) : x + AROUND + 1].reshape(-1, 3)
    blue, green, red = (int(value) for value in np.median(around, axis=0))
    return blue, green, red
