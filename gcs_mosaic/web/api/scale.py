"""The scale: two points and the metres between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from aiohttp import web

from gcs_mosaic.notes.anchoring import anchored
from gcs_mosaic.notes.checked import Unfit, number_of, point_of
from gcs_mosaic.notes.pins import SetPin
from gcs_mosaic.notes.scales import LEAST_UNITS, KnownDistance, island_scales, metres_per_unit
from gcs_mosaic.notes.told import place_document
from gcs_mosaic.web.api.common import BASE, answer, body_of, in_thread
from gcs_mosaic.web.api.notes import NOTES, Notes, id_of, island_of, reading, told_anew, who_of, writing

ONE = BASE + r"/scale/{id:[0-9]{1,9}}"
LEAST_M, MOST_M = 0.01, 100_000.0


def add_routes(app: web.Application) -> None:
    app.router.add_get(f"{BASE}/scale", reading(every))
    app.router.add_post(f"{BASE}/scale", writing(create))
    app.router.add_delete(ONE, writing(delete))
    app.router.add_post(f"{ONE}/restore", writing(restore))


async def every(request: web.Request) -> web.StreamResponse:
    """GET: metres of a canvas unit for each island, and the distances that were given."""
    notes = request.app[NOTES]
    (revision, *laid), known = await notes.run(lambda: (notes.pinned(), notes.scales.all()))
    return told_anew(request, {"revision": revision, **await in_thread(request, _documents, notes, known, *laid)})


async def create(request: web.Request) -> web.StreamResponse:
    """POST: from, to (canvas), metres, on an island."""
    told, notes = await body_of(request), request.app[NOTES]
    island, who = island_of(told.get("island")), who_of(told.get("who"))
    metres = number_of(told.get("metres"), "metres", LEAST_M, MOST_M)
    points = point_of(told.get("from"), "from"), point_of(told.get("to"), "to")
    first, second = [await in_thread(request, notes.follower.bound, island, *point) for point in points]
    if metres_per_unit(notes.follower.place(first), notes.follower.place(second), metres) is None:
        raise Unfit(f"from and to are to be {LEAST_UNITS:g} canvas unit apart at least, on one island.")
    known = await notes.run(notes.scales.create, (first, second), metres, who)
    return web.json_response(await in_thread(request, _known, notes, known), status=201)


async def delete(request: web.Request) -> web.StreamResponse:
    """DELETE: the one given before holds again; can be restored."""
    return await _set_deleted(request, deleted=True)


async def restore(request: web.Request) -> web.StreamResponse:
    """POST: undo a deletion."""
    return await _set_deleted(request, deleted=False)


async def _set_deleted(request: web.Request, *, deleted: bool) -> web.StreamResponse:
    notes, number = request.app[NOTES], id_of(request)
    known = await notes.run(lambda: notes.scales.set_deleted(number, deleted=deleted))
    return answer(await in_thread(request, _known, notes, known))


def _documents(
    notes: Notes, known: Sequence[KnownDistance], pins: Sequence[SetPin], by_positions: bool
) -> dict[str, Any]:
    scales = island_scales(known, notes.follower.place, anchored(notes.islands(pins, by_positions)))
    islands = [
        {"island": one.island, "metres_per_unit": one.metres_per_unit, "source": one.source, "scale": one.scale}
        for one in scales.values()
    ]
    return {"islands": islands, "distances": [_known(notes, one) for one in known]}


def _known(notes: Notes, one: KnownDistance) -> dict[str, Any]:
    first, second = (place_document(end, notes.follower.place(end)) for end in one.ends)
    head = {"id": one.id, "deleted": one.deleted, "metres": one.metres, "who": one.who, "utc": one.utc}
    return {**head, "from": first, "to": second}
