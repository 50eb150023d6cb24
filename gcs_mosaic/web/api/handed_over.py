"""What a flight hands over: a mission for ground stations, one file for the debriefing, a find as a message."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from aiohttp import web

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.detection.persons import Clothes, Person, Posture
from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.handover.search_course import Looked, SoughtPerson, looked_at
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor, anchor_of
from gcs_mosaic.notes.anchors.pins import SetPin
from gcs_mosaic.notes.anchors.scales import IslandScale
from gcs_mosaic.notes.finds.finds import Find, PlacedFind, placed
from gcs_mosaic.notes.search.seen_ground import StampedGround
from gcs_mosaic.notes.storage.checked import Unfit, Who
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.web.api.asked import asked_body, asked_query
from gcs_mosaic.web.api.common import BASE, SLOW_POOL, VIEW, answer, in_thread, missing
from gcs_mosaic.web.api.detection import MEASURING, outline_of
from gcs_mosaic.web.api.finds import COT, ONE
from gcs_mosaic.web.api.layers import TILES
from gcs_mosaic.web.api.maps import as_svg
from gcs_mosaic.web.api.notes import NOTES, IslandNumber, Notes, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Media, Operations, Reply
from gcs_mosaic.web.api.scale import scales_of
from gcs_mosaic.web.guard import POLICY
from gcs_mosaic.web.tile_answer import tagged

if TYPE_CHECKING:
    from gcs_mosaic.handover.cot_address import CotAddress

OPERATIONS = Operations()
LONGEST_CODE = 600  # bytes: more makes squares that a telephone does not tell apart
LEAST_LOOKS = 2  # through trees
FINDING_NAMES_S = 1.0  # what looking up a name, which has no limit of its own, may take beyond all that has one
Pinned = tuple[Sequence[SetPin], bool]  # the pins, and whether positions may lay the map
TYPES = {
    "plan": "application/x-qgc-plan+json",
    "waypoints": "text/plain",
    "kml": "application/vnd.google-earth.kml+xml",
    "gpx": "application/gpx+xml",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionQuery:
    """What is to be flown again; without anything the gaps of all islands with an anchor."""

    island: IslandNumber | None = None
    looks: Annotated[int, Limits(least=1, most=100), "also what fewer frames saw"] = 1
    gsd: Annotated[float | None, Limits(least=0.001, most=10), "also what was seen coarser, in metres a pixel"] = None
    height: Annotated[
        float | None,
        Limits(least=1, most=10_000),
        "over ground as it was flown, in metres, where the pictures do not tell",
    ] = None
    below: Annotated[
        float | None,
        Limits(least=0.01, most=0.99),
        "instead: where the person would have been seen with a lower probability",
    ] = None
    posture: Posture = "lying"
    clothes: Clothes = "blue"
    outline: Annotated[
        str,
        Limits(longest=6000),
        "instead: all ground inside x,y;x,y;... on the island's canvas, so that `looks` frames show each place",
    ] = ""
    at: Annotated[float, Limits(least=0.1, most=4), "height for an outline, in heights of the flight"] = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DebriefingQuery:
    """Whom the probability is of."""

    posture: Posture = "lying"
    clothes: Clothes = "blue"


@dataclass(frozen=True, slots=True, kw_only=True)
class SendBody:
    """Who sends it."""

    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class SentAnswer:
    """Whom a find was sent to; over UDP nobody says whether it came."""

    sent_to: str


class Sender:
    """One thread on which finds are sent, one after another: a name that nobody knows, or a network that is away, holds up no
    question."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="sender")
        self._sending: Future[None] | None = None

    async def send(self, event: str, address: CotAddress) -> None:
        """Raises UsageError where it is not sent."""
        from gcs_mosaic.handover.cot import SEND_S, not_sent, send_cot

        if self._sending is not None and not self._sending.done():
            raise UsageError("Another find is being sent: send this one in some seconds.")
        self._sending = self._pool.submit(send_cot, event, address, SEND_S)
        try:
            await asyncio.wait_for(asyncio.wrap_future(self._sending), SEND_S + FINDING_NAMES_S)
        except TimeoutError as error:
            raise not_sent(address, "its name is not found") from error

    async def end(self, _: web.Application) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


SENDER = web.AppKey("sender", Sender)


def add_sending(app: web.Application) -> None:
    """Send finds as long as the application runs."""
    app[SENDER] = Sender()
    app.on_cleanup.append(app[SENDER].end)


@OPERATIONS.add(
    "GET",
    BASE + r"/mission.{format:(plan|waypoints|kml|gpx)}",
    Reply("The file: advice that arms nothing; altitudes are relative to home.", Media(tuple(TYPES.values()))),
    query=MissionQuery,
    failures={409: "There is no mission, and why: no anchor, nothing to be flown again, no height.", **NO_NOTES},
)
async def mission(request: web.Request) -> web.StreamResponse:
    """A mission over gaps, and over what was seen too seldom or too coarsely: waypoints, and camera triggers by distance."""
    asked, notes, kind = asked_query(request, MissionQuery), request.app[NOTES], request.match_info["format"]
    outline = outline_of(asked.outline)
    if outline is not None and (asked.island is None or asked.looks < LEAST_LOOKS):
        raise Unfit(f"with an outline, island is to be given, and looks to be {LEAST_LOOKS} or more.")
    _, *pinned = await notes.run(notes.pinned)
    try:
        scales = await scales_of(request)
        text = await in_thread(request, _file, request, asked, pinned, kind, scales, pool=SLOW_POOL)
    except UsageError as error:
        raise web.HTTPConflict(text=f"{error}\n") from error
    headers = {"Content-Disposition": f'attachment; filename="gaps.{kind}"'}
    return web.Response(text=text, content_type=TYPES[kind], charset="utf-8", headers=headers)


@OPERATIONS.add(
    "GET",
    f"{BASE}/debriefing.html",
    Reply("The file; it loads nothing.", Media(("text/html",))),
    query=DebriefingQuery,
    failures=NO_NOTES,
)
async def debriefing(request: web.Request) -> web.StreamResponse:
    """One file for the debriefing: the map, the aircraft's way, finds, what was not seen and not looked at, by time; the
    probability of pictures that were measured, which asking under islands/N/detection does."""
    asked, notes = asked_query(request, DebriefingQuery), request.app[NOTES]
    person = Person(posture=asked.posture, clothes=asked.clothes)
    (_, *pinned), finds = await notes.run(lambda: (notes.pinned(), notes.finds.all()))
    grounds = await in_thread(request, _grounds, request, pool=SLOW_POOL)
    looked = await notes.run(_looked, notes, grounds)
    metres = {island: one.metres_per_unit for island, one in (await scales_of(request)).items()}
    detections = request.app[MEASURING].detections
    sought = SoughtPerson(person, detections, detections.known, metres)
    text = await in_thread(request, _debriefing, request, pinned, finds, looked, sought, pool=SLOW_POOL)
    from gcs_mosaic.notes.finds.report import POLICY as REPORT_POLICY

    policy = f"{REPORT_POLICY}; frame-ancestors 'none'"
    headers = {"Content-Disposition": 'attachment; filename="debriefing.html"', POLICY: policy}
    return web.Response(text=text, content_type="text/html", charset="utf-8", headers=headers)


@OPERATIONS.add("GET", f"{ONE}/message.txt", Reply("The text, UTF-8.", tagged=True), failures=NO_NUMBER | NO_NOTES)
async def message(request: web.Request) -> web.StreamResponse:
    """A find to be sent: what it is, where and how exactly, when."""
    from gcs_mosaic.handover.message import as_message

    one, view = await _find(request), request.app[VIEW]
    text = await in_thread(request, as_message, one, view.root.resolve().name, view)
    return tagged(request, text.encode("utf-8", "replace"), "text/plain", charset="utf-8")


@OPERATIONS.add("GET", f"{ONE}/code.svg", Reply("The code.", Media(("image/svg+xml",))), failures=NO_NUMBER | NO_NOTES)
async def code(request: web.Request) -> web.StreamResponse:
    """A find's message as a QR code, without what is too long for one that a telephone reads from a screen."""
    from gcs_mosaic.handover.message import as_message

    one, view = await _find(request), request.app[VIEW]
    text = await in_thread(request, as_message, one, view.root.resolve().name, view)
    short = text.encode("utf-8", "replace")[:LONGEST_CODE].decode("utf-8", "ignore")
    return web.Response(text=await in_thread(request, as_svg, short), content_type="image/svg+xml")


@OPERATIONS.add(
    "GET",
    f"{ONE}/crop.jpg",
    Reply("The picture.", Media(("image/jpeg",)), tagged=True),
    failures={404: "There is no such find, or no original of it that can be read.", **NO_NOTES},
)
async def crop(request: web.Request) -> web.StreamResponse:
    """What a find shows: 400 px of the original around it."""
    from gcs_mosaic.handover.message import crop_of_find

    data = await in_thread(request, crop_of_find, await _find(request), request.app[VIEW], pool=SLOW_POOL)
    if data is None:
        raise missing("No original that shows it can be read.")
    return tagged(request, data, "image/jpeg")


@OPERATIONS.add(
    "GET",
    f"{ONE}/event.cot",
    Reply("The event.", Media(("application/xml",))),
    failures={409: "The find lies on an island without an anchor.", **NO_NUMBER, **NO_NOTES},
)
async def event(request: web.Request) -> web.StreamResponse:
    """A find as an event of Cursor on Target, for ATAK and TAK servers."""
    text = await _event(request)
    headers = {"Content-Disposition": f'attachment; filename="find-{id_of(request)}.cot"'}
    return web.Response(text=text, content_type="application/xml", charset="utf-8", headers=headers)


@OPERATIONS.add(
    "POST",
    f"{ONE}/cot",
    Reply("It was sent.", SentAnswer),
    body=SendBody,
    failures={
        409: "It was not sent, and why: no anchor, no address in the settings, nobody there, another one on its way.",
        **NO_NUMBER,
    },
)
async def send(request: web.Request) -> web.StreamResponse:
    """Send a find as an event of Cursor on Target to the address that the settings name (`web: {cot: …}`), and nowhere else."""
    from gcs_mosaic.handover.cot_address import cot_address

    await asked_body(request, SendBody)
    told = request.app[COT]
    if not told:
        raise web.HTTPConflict(text="The settings name nobody to send finds to: web: {cot: 'udp:239.2.3.1:6969'}.\n")
    text = await _event(request)
    try:
        await request.app[SENDER].send(text, cot_address(told))
    except UsageError as error:
        raise web.HTTPConflict(text=f"{error}\n") from error
    return answer(SentAnswer(sent_to=told))


async def _event(request: web.Request) -> str:
    """Raises HTTPConflict where a find has no coordinate."""
    from gcs_mosaic.handover.cot import as_cot

    one, view = await _find(request), request.app[VIEW]
    number = one.place.number
    try:
        taken = None if number is None else await in_thread(request, view.capture_time, number)
        return as_cot(one, view.root.resolve().name, taken, time.time())
    except UsageError as error:
        raise web.HTTPConflict(text=f"{error}\n") from error


async def _find(request: web.Request) -> PlacedFind:
    """The find of the address, where it lies now; not one that was deleted. Raises HTTPNotFound."""
    notes = request.app[NOTES]
    (_, *pinned), find = await notes.run(lambda: (notes.pinned(), notes.finds.get(id_of(request))))
    if find.deleted:
        raise missing("There is no find of that number.")
    return (await in_thread(request, _placed, notes, [find], pinned))[0]


def _placed(notes: Notes, finds: Sequence[Find], pinned: Pinned) -> list[PlacedFind]:
    return placed(finds, notes.follower, anchor_of(notes.islands(*pinned)))


def _grounds(request: web.Request) -> dict[int, tuple[StampedGround, int]]:
    """Of each island what is painted, and its finest level."""
    view, notes = request.app[VIEW], request.app[NOTES]
    table = view.table()
    islands = [one for one in told_islands(view.root) if one.get("merged_into") is None]
    return {one["id"]: (notes.ground.of(table, one["id"], math.inf), one["maxzoom"]) for one in islands}


def _looked(notes: Notes, grounds: Mapping[int, tuple[StampedGround, int]]) -> dict[int, Looked]:
    return {island: looked_at(notes.reviews, ground, island, finest) for island, (ground, finest) in grounds.items()}


def _debriefing(
    request: web.Request, pinned: Pinned, finds: Sequence[Find], looked: Mapping[int, Looked], sought: SoughtPerson
) -> str:
    from gcs_mosaic.handover.debriefing import Searched, as_debriefing  # it loads what decodes

    notes, view, tiles = request.app[NOTES], request.app[VIEW], request.app[TILES]
    searched = Searched(finds=_placed(notes, finds, pinned), laid=notes.islands(*pinned), looked=looked, sought=sought)
    return as_debriefing(view, searched, tiles.islands.of, time.time())


def _file(
    request: web.Request, asked: MissionQuery, pinned: Pinned, kind: str, scales: Mapping[int, IslandScale]
) -> str:
    from gcs_mosaic.handover.mission import MissionWish, planned
    from gcs_mosaic.handover.mission_files import MISSION_FILES

    view, tiles = request.app[VIEW], request.app[TILES]
    islands = [one["id"] for one in told_islands(view.root) if one.get("merged_into") is None]
    wish = MissionWish(
        island=asked.island,
        looks=asked.looks,
        gsd_m=asked.gsd,
        height_m=asked.height,
        below=asked.below,
        person=Person(posture=asked.posture, clothes=asked.clothes),
        outline=() if (outline := outline_of(asked.outline)) is None else tuple((x, y) for x, y in outline.tolist()),
        at_height=asked.at,
    )
    anchors = _anchors(request.app[NOTES].islands(*pinned))
    detections = request.app[MEASURING].detections

    def known(island: int, person: Person, by_anchor: float) -> DetectionMap | None:
        """Of a person as large as the page says: a distance that somebody has given goes before an anchor."""
        scale = scales.get(island)
        return detections.known(island, person, person.side_m / scale.metres_per_unit if scale else by_anchor)

    return MISSION_FILES[kind](planned(view, anchors, islands, tiles.islands.of, wish, known))


def _anchors(laid: Mapping[int, IslandAnchor]) -> dict[int, Anchor]:
    return {number: one.anchor for number, one in laid.items() if one.anchor is not None}
