"""Hints that were dismissed."""

from __future__ import annotations

from aiohttp import web

from gcs_mosaic.notes.checked import text_of
from gcs_mosaic.web.api.common import BASE, answer, body_of, missing
from gcs_mosaic.web.api.notes import NOTES, reading, told_anew, who_of, writing

PATH = f"{BASE}/hints/dismissed"
ONE = PATH + r"/{hint:[A-Za-z0-9._:-]{1,100}}"
LONGEST_HINT = 100


def add_routes(app: web.Application) -> None:
    app.router.add_get(PATH, reading(every))
    app.router.add_post(PATH, writing(dismiss))
    app.router.add_delete(ONE, writing(bring_back))


async def every(request: web.Request) -> web.StreamResponse:
    """GET: the keys of all of them, with who and when."""
    notes = request.app[NOTES]
    revision, hints = await notes.run(lambda: (notes.book.revision, notes.dismissed.all()))
    return told_anew(request, {"revision": revision, "dismissed": hints})


async def dismiss(request: web.Request) -> web.StreamResponse:
    """POST: dismiss the hint of a key."""
    told, notes = await body_of(request), request.app[NOTES]
    hint, who = text_of(told.get("hint"), "hint", LONGEST_HINT, needed=True), who_of(told.get("who"))
    await notes.run(notes.dismissed.dismiss, hint, who)
    return answer({"hint": hint})


async def bring_back(request: web.Request) -> web.StreamResponse:
    """DELETE: undo it."""
    notes, hint = request.app[NOTES], request.match_info["hint"]
    if not await notes.run(notes.dismissed.bring_back, hint):
        raise missing("That hint was not dismissed.")
    return answer({"hint": hint})
