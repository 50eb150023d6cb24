"""Finds: markers that people set, and what other programs take of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from aiohttp import web

from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.anchors.pins import SetPin
from gcs_mosaic.notes.finds.exports import CSV_ENCODING, as_csv, as_geojson, as_kml
from gcs_mosaic.notes.finds.finds import Find, NewFind, Outdated, PlacedFind, placed
from gcs_mosaic.notes.ground.places import GeoPlace, PlaceAnswer, place_answer
from gcs_mosaic.notes.storage.checked import (
    LONGEST_LABEL,
    LONGEST_NAME,
    LONGEST_NOTE,
    Unfit,
    Utc,
    Who,
)
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.web.api.asked import asked_body
from gcs_mosaic.web.api.common import BASE, VIEW, MapRevision, answer, in_thread, map_revision, told_anew
from gcs_mosaic.web.api.notes import NO_PLACE, NOTES, Notes, PlacedBody, bound, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Failures, Media, Operations, Reply
from gcs_mosaic.web.guard import POLICY

ONE = BASE + r"/finds/{id:[0-9]{1,9}}"
Revision = Annotated[int, Limits(least=0, most=1 << 53)]


IF_MATCH = {"If-Match": "The revision that is changed, in quotes, instead of `revision` in the body."}
FILES = Media(("application/geo+json", "text/csv", "application/vnd.google-earth.kml+xml", "text/html"))
OPERATIONS = Operations()
COT = web.AppKey("cot", str)  # whom finds are sent to on wish, as of `web: {cot: …}`; empty: nobody

Kind = Annotated[str, Limits(longest=LONGEST_NAME)]
Label = Annotated[str, Limits(longest=LONGEST_LABEL)]
Note = Annotated[str, Limits(longest=LONGEST_NOTE, lines=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class NewFindBody(PlacedBody):
    """A find to be set on the map, or in an original."""

    kind: Kind = ""
    label: Label = ""
    note: Note = ""
    who: Who
    key: Annotated[str, Limits(longest=64), "sent again, it makes no second find"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FindEditBody(PlacedBody):
    """What is to be another; the rest stays."""

    kind: Kind | None = None
    label: Label | None = None
    note: Note | None = None
    who: Who
    revision: Revision | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FindChangeBody:
    """Who, and the revision that is changed."""

    who: Who
    revision: Revision | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FindsQuery:
    """Which finds."""

    deleted: Annotated[Literal["1"] | None, "those that were deleted too"] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoAnswer:
    """A place on earth (WGS 84)."""

    longitude: Annotated[float, "degrees"]
    latitude: Annotated[float, "degrees"]
    error_m: Annotated[float, "how far off it may be (95 %)"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindAnswer(PlaceAnswer):
    """A find, where it lies now."""

    id: int
    revision: int
    deleted: bool
    kind: Kind
    label: Label
    note: Note
    who: Who
    created_utc: Utc
    changed_by: Who
    changed_utc: Utc
    in_original: Annotated[bool, "set in a frame's original, not on the map"]
    geo: Annotated[GeoAnswer | None, "null while the map has no anchor"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindsAnswer:
    """The finds, where they lie now."""

    revision: Annotated[int, "of all that people have added"]
    map_revision: MapRevision
    cot: Annotated[bool, "whether finds can be sent as Cursor on Target: the settings name whom to"] = False
    finds: Sequence[FindAnswer]


OUTDATED: Failures = {
    409: Reply("Somebody else has changed it: what it has become.", FindAnswer),
    428: "The revision that is changed is to be given.",
    **NO_NUMBER,
    **NO_NOTES,
}


@OPERATIONS.add(
    "GET", f"{BASE}/finds", Reply("The finds.", FindsAnswer, tagged=True), query=FindsQuery, failures=NO_NOTES
)
async def every(request: web.Request) -> web.StreamResponse:
    """All finds, where they lie now."""
    notes, deleted = request.app[NOTES], request.query.get("deleted") == "1"
    pinned, finds = await notes.run(lambda: (notes.pinned(), notes.finds.all(deleted=deleted)))
    (revision, *laid), of_map = pinned, await map_revision(request)
    shown = await in_thread(request, _placed, notes, finds, *laid)
    can_send = bool(request.app[COT])
    told = FindsAnswer(revision=revision, map_revision=of_map, cot=can_send, finds=[_told(one) for one in shown])
    return told_anew(request, told)


@OPERATIONS.add("GET", ONE, Reply("The find.", FindAnswer, tagged=True), failures=NO_NUMBER | NO_NOTES)
async def single(request: web.Request) -> web.StreamResponse:
    """One find, deleted or not."""
    notes = request.app[NOTES]
    find = await notes.run(notes.finds.get, id_of(request))
    return told_anew(request, await _answered(request, find))


@OPERATIONS.add(
    "POST", f"{BASE}/finds", Reply("It is on the disk.", FindAnswer, 201), body=NewFindBody, failures=NO_NOTES
)
async def create(request: web.Request) -> web.StreamResponse:
    """Set a find on the map (island, x, y), or in an original (frame, pixel)."""
    asked, notes = await asked_body(request, NewFindBody), request.app[NOTES]
    binding = await bound(request, asked)
    if binding is None:
        raise Unfit(NO_PLACE)
    new = NewFind(
        kind=asked.kind,
        label=asked.label,
        note=asked.note,
        who=asked.who,
        in_original=asked.frame is not None,
        binding=binding,
        key=asked.key or None,
    )
    find = await notes.run(notes.finds.create, new)
    return answer(await _answered(request, find), 201, Location=f"{BASE}/finds/{find.id}")


@OPERATIONS.add(
    "PATCH", ONE, Reply("It is on the disk.", FindAnswer), body=FindEditBody, headers=IF_MATCH, failures=OUTDATED
)
async def edit(request: web.Request) -> web.StreamResponse:
    """Change texts or place of a find that is at `revision`."""
    asked, notes = await asked_body(request, FindEditBody), request.app[NOTES]
    binding = await bound(request, asked)
    texts = {"kind": asked.kind, "label": asked.label, "note": asked.note}
    changes: dict[str, Any] = {name: text for name, text in texts.items() if text is not None}
    changes["in_original"] = asked.frame is not None
    return await _changed(
        request,
        asked,
        lambda number, revision, who: notes.finds.edit(number, revision, who, changes, binding),
    )


@OPERATIONS.add(
    "DELETE", ONE, Reply("It is deleted.", FindAnswer), body=FindChangeBody, headers=IF_MATCH, failures=OUTDATED
)
async def delete(request: web.Request) -> web.StreamResponse:
    """Delete; can be restored."""
    asked = await asked_body(request, FindChangeBody)
    return await _changed(request, asked, request.app[NOTES].finds.delete)


@OPERATIONS.add(
    "POST",
    f"{ONE}/restore",
    Reply("It is there again.", FindAnswer),
    body=FindChangeBody,
    headers=IF_MATCH,
    failures=OUTDATED,
)
async def restore(request: web.Request) -> web.StreamResponse:
    """Undo a deletion."""
    asked = await asked_body(request, FindChangeBody)
    return await _changed(request, asked, request.app[NOTES].finds.restore)


@OPERATIONS.add(
    "GET",
    BASE + r"/finds.{format:(geojson|csv|kml|html)}",
    Reply("The file. Without an anchor places are canvas units.", FILES),
    failures=NO_NOTES,
)
async def exported(request: web.Request) -> web.StreamResponse:
    """All finds for other programs, or as a report to print."""
    notes, kind = request.app[NOTES], request.match_info["format"]
    (_, *laid), finds = await notes.run(lambda: (notes.pinned(), notes.finds.all()))
    shown = await in_thread(request, _placed, notes, finds, *laid)
    text = await in_thread(request, _export, request, shown, kind)
    types = {"geojson": "application/geo+json", "csv": "text/csv", "kml": "application/vnd.google-earth.kml+xml"}
    how = "inline" if kind == "html" else "attachment"
    headers = {"Content-Disposition": f'{how}; filename="finds.{kind}"'}
    if kind == "html":
        from gcs_mosaic.notes.finds.report import POLICY as REPORT_POLICY

        headers[POLICY] = f"{REPORT_POLICY}; frame-ancestors 'none'"
    body = text.encode(CSV_ENCODING if kind == "csv" else "utf-8")
    return web.Response(body=body, content_type=types.get(kind, "text/html"), charset="utf-8", headers=headers)


def _placed(notes: Notes, finds: Sequence[Find], pins: Sequence[SetPin], by_positions: bool) -> list[PlacedFind]:
    return placed(finds, notes.follower, anchor_of(notes.islands(pins, by_positions)))


def _export(request: web.Request, shown: Sequence[PlacedFind], kind: str) -> str:
    flight = request.app[VIEW].root.resolve().name
    if kind == "csv":
        return as_csv(shown)
    if kind == "html":
        from gcs_mosaic.handover.beneath import BeneathLeaves
        from gcs_mosaic.notes.finds.report import as_report

        view = request.app[VIEW]
        return as_report(shown, flight, view, time.time(), BeneathLeaves(view))
    return (as_geojson if kind == "geojson" else as_kml)(shown, flight)


async def _changed(
    request: web.Request, asked: FindEditBody | FindChangeBody, work: Callable[[int, int, str], Find]
) -> web.StreamResponse:
    """One find changed, if it is at the revision that the sender knows: by If-Match, or `revision` in the body."""
    revision = asked.revision if asked.revision is not None else _matched_revision(request)
    try:
        find = await request.app[NOTES].run(work, id_of(request), revision, asked.who)
    except Outdated as error:
        return answer(await _answered(request, error.newest), 409)
    return answer(await _answered(request, find))


def _matched_revision(request: web.Request) -> int:
    value = request.if_match[0].value if request.if_match else ""
    if value.isascii() and value.isdigit() and len(value) <= 15:
        return int(value)
    raise web.HTTPPreconditionRequired(text="The revision that is changed is to be given.\n")


async def _answered(request: web.Request, find: Find) -> FindAnswer:
    notes = request.app[NOTES]
    _, *laid = await notes.run(notes.pinned)
    return _told((await in_thread(request, _placed, notes, [find], *laid))[0])


def _told(one: PlacedFind) -> FindAnswer:
    find, at, geo = one.find, place_answer(one.find.binding, one.place), one.geo
    return FindAnswer(
        id=find.id,
        revision=find.revision,
        deleted=find.deleted,
        kind=find.kind,
        label=find.label,
        note=find.note,
        who=find.who,
        created_utc=find.created_utc,
        changed_by=find.changed_by,
        changed_utc=find.changed_utc,
        in_original=find.in_original,
        island=at.island,
        x=at.x,
        y=at.y,
        frame=at.frame,
        follows=at.follows,
        geo=None if geo is None else _geo(geo),
    )


def _geo(geo: GeoPlace) -> GeoAnswer:
    return GeoAnswer(longitude=geo.longitude_deg, latitude=geo.latitude_deg, error_m=geo.error_m)
