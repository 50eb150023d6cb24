"""Finds: markers that people set, and what other programs take of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from aiohttp import web

from gcs_mosaic.notes.anchoring import anchor_of
from gcs_mosaic.notes.binding import Binding
from gcs_mosaic.notes.checked import (
    FURTHEST,
    LONGEST_LABEL,
    LONGEST_NAME,
    LONGEST_NOTE,
    Unfit,
    point_of,
    text_of,
    whole_of,
)
from gcs_mosaic.notes.exports import as_csv, as_geojson, as_kml
from gcs_mosaic.notes.finds import Find, NewFind, Outdated
from gcs_mosaic.notes.pins import SetPin
from gcs_mosaic.notes.told import PlacedFind, find_document, placed
from gcs_mosaic.web.api.common import BASE, VIEW, answer, body_of, in_thread
from gcs_mosaic.web.api.notes import NOTES, Notes, id_of, island_of, reading, told_anew, who_of, writing
from gcs_mosaic.web.guard import POLICY

ONE = BASE + r"/finds/{id:[0-9]{1,9}}"
MOST_REVISION = 1 << 53
LONGEST_KEY = 64


def add_routes(app: web.Application) -> None:
    app.router.add_get(f"{BASE}/finds", reading(every))
    app.router.add_post(f"{BASE}/finds", writing(create))
    app.router.add_get(ONE, reading(single))
    app.router.add_patch(ONE, writing(edit))
    app.router.add_delete(ONE, writing(delete))
    app.router.add_post(f"{ONE}/restore", writing(restore))
    app.router.add_get(BASE + r"/finds.{format:(geojson|csv|kml|html)}", reading(exported))


async def every(request: web.Request) -> web.StreamResponse:
    """GET: all finds where they lie now; with `?deleted=1` those that were deleted too."""
    notes, deleted = request.app[NOTES], request.query.get("deleted") == "1"
    pinned, finds = await notes.run(lambda: (notes.pinned(), notes.finds.all(deleted=deleted)))
    revision, *laid = pinned
    shown = await in_thread(request, _placed, notes, finds, *laid)
    return told_anew(request, {"revision": revision, "finds": [find_document(one) for one in shown]})


async def single(request: web.Request) -> web.StreamResponse:
    """GET: one find, deleted or not."""
    notes = request.app[NOTES]
    find = await notes.run(notes.finds.get, id_of(request))
    return told_anew(request, await _document(request, find))


async def create(request: web.Request) -> web.StreamResponse:
    """POST: set a find on the map (island, x, y) or in an original (frame, pixel)."""
    told, notes = await body_of(request), request.app[NOTES]
    texts, who = _texts(told), who_of(told.get("who"))
    key = text_of(told.get("key"), "key", LONGEST_KEY) or None
    binding, in_original = await _binding(request, told)
    if binding is None:
        raise Unfit("island, x and y are to be given, or frame and pixel.")
    new = NewFind(
        kind=texts.get("kind", ""),
        label=texts.get("label", ""),
        note=texts.get("note", ""),
        who=who,
        in_original=in_original,
        binding=binding,
        key=key,
    )
    find = await notes.run(notes.finds.create, new)
    document = await _document(request, find)
    return web.json_response(document, status=201, headers={"Location": f"{BASE}/finds/{find.id}"})


async def edit(request: web.Request) -> web.StreamResponse:
    """PATCH: change texts or place of a find that is at `revision`; 409 with what it has become if it is not."""
    told, notes = await body_of(request), request.app[NOTES]
    binding, in_original = await _binding(request, told)
    changes = _texts(told) | {"in_original": in_original}
    return await _changed(
        request,
        told,
        lambda number, revision, who: notes.finds.edit(number, revision, who, changes, binding),
    )


async def delete(request: web.Request) -> web.StreamResponse:
    """DELETE: the find can be restored."""
    told = await body_of(request)
    return await _changed(request, told, request.app[NOTES].finds.delete)


async def restore(request: web.Request) -> web.StreamResponse:
    """POST: undo a deletion."""
    told = await body_of(request)
    return await _changed(request, told, request.app[NOTES].finds.restore)


async def exported(request: web.Request) -> web.StreamResponse:
    """GET: all finds as GeoJSON, CSV, KML, or a report to print."""
    notes, kind = request.app[NOTES], request.match_info["format"]
    (_, *laid), finds = await notes.run(lambda: (notes.pinned(), notes.finds.all()))
    shown = await in_thread(request, _placed, notes, finds, *laid)
    text = await in_thread(request, _export, request, shown, kind)
    types = {"geojson": "application/geo+json", "csv": "text/csv", "kml": "application/vnd.google-earth.kml+xml"}
    how = "inline" if kind == "html" else "attachment"
    headers = {"Content-Disposition": f'{how}; filename="finds.{kind}"'}
    if kind == "html":
        from gcs_mosaic.notes.report import POLICY as REPORT_POLICY

        headers[POLICY] = f"{REPORT_POLICY}; frame-ancestors 'none'"
    return web.Response(text=text, content_type=types.get(kind, "text/html"), charset="utf-8", headers=headers)


def _placed(notes: Notes, finds: Sequence[Find], pins: Sequence[SetPin], by_positions: bool) -> list[PlacedFind]:
    return placed(finds, notes.follower, anchor_of(notes.islands(pins, by_positions)))


def _export(request: web.Request, shown: Sequence[PlacedFind], kind: str) -> str:
    flight = request.app[VIEW].root.resolve().name
    if kind == "csv":
        return as_csv(shown)
    if kind == "html":
        from gcs_mosaic.notes.report import as_report

        return as_report(shown, flight, request.app[VIEW], time.time())
    return (as_geojson if kind == "geojson" else as_kml)(shown, flight)


async def _changed(
    request: web.Request, told: dict[str, Any], work: Callable[[int, int, str], Find]
) -> web.StreamResponse:
    """One find changed, if it is at the revision that the sender knows: by If-Match, or `revision` in the body."""
    who, revision = who_of(told.get("who")), _known_revision(request, told)
    try:
        find = await request.app[NOTES].run(work, id_of(request), revision, who)
    except Outdated as error:
        return web.json_response(await _document(request, error.newest), status=409)
    return answer(await _document(request, find))


def _known_revision(request: web.Request, told: dict[str, Any]) -> int:
    given: Any = told.get("revision")
    if given is None and request.if_match:
        value = request.if_match[0].value
        given = int(value) if value.isascii() and value.isdigit() and len(value) <= 15 else None
    if given is None:
        raise web.HTTPPreconditionRequired(text="The revision that is changed is to be given.\n")
    return whole_of(given, "revision", 0, MOST_REVISION)


def _texts(told: dict[str, Any]) -> dict[str, str]:
    """Those of kind, label and note that were sent."""
    longest = {"kind": LONGEST_NAME, "label": LONGEST_LABEL, "note": LONGEST_NOTE}
    return {
        name: text_of(told[name], name, most, lines=name == "note") for name, most in longest.items() if name in told
    }


async def _binding(request: web.Request, told: dict[str, Any]) -> tuple[Binding | None, bool]:
    """Where it was set, if that was sent, and whether in an original."""
    follower = request.app[NOTES].follower
    if told.get("frame") is not None:
        number = whole_of(told["frame"], "frame", 0, 1 << 53)
        found = await in_thread(request, follower.bound_to_pixel, number, *point_of(told.get("pixel"), "pixel"))
        if found is None:
            raise Unfit("That frame is not on the map, or has no such pixel.")
        return found, True
    if told.get("island") is None:
        return None, False
    x, y = point_of([told.get("x"), told.get("y")], "x, y", FURTHEST)
    return await in_thread(request, follower.bound, island_of(told["island"]), x, y), False


async def _document(request: web.Request, find: Find) -> dict[str, Any]:
    notes = request.app[NOTES]
    _, *laid = await notes.run(notes.pinned)
    return find_document((await in_thread(request, _placed, notes, [find], *laid))[0])
