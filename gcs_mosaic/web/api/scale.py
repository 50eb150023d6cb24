"""The scale: two points and the metres between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from aiohttp import web

from gcs_mosaic.notes.anchors.anchoring import anchored
from gcs_mosaic.notes.anchors.pins import SetPin
from gcs_mosaic.notes.anchors.scales import LEAST_UNITS, IslandScale, KnownDistance, island_scales, metres_per_unit
from gcs_mosaic.notes.ground.places import PlaceAnswer, place_answer
from gcs_mosaic.notes.storage.checked import Unfit, Utc, Who
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.web.api.asked import asked_body
from gcs_mosaic.web.api.common import BASE, MapRevision, answer, in_thread, map_revision, told_anew
from gcs_mosaic.web.api.notes import NOTES, CanvasPoint, IslandNumber, Notes, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Operations, Reply

ONE = BASE + r"/scale/{id:[0-9]{1,9}}"
OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class NewDistanceBody:
    """Two points of an island and the metres between them."""

    island: IslandNumber
    from_: CanvasPoint
    to: CanvasPoint
    metres: Annotated[float, Limits(least=0.01, most=100_000.0)]
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceAnswer:
    """A distance that somebody has given."""

    id: int
    deleted: bool
    metres: float
    who: Who
    utc: Utc
    from_: PlaceAnswer
    to: PlaceAnswer


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleAnswer:
    """Metres of a canvas unit of each island, and the distances given."""

    revision: int
    map_revision: MapRevision
    islands: Sequence[IslandScale]
    distances: Sequence[DistanceAnswer]


@OPERATIONS.add("GET", f"{BASE}/scale", Reply("The scales.", ScaleAnswer, tagged=True), failures=NO_NOTES)
async def every(request: web.Request) -> web.StreamResponse:
    """Metres of a canvas unit of each island, and the distances given."""
    notes = request.app[NOTES]
    (revision, *laid), known = await notes.run(lambda: (notes.pinned(), notes.scales.all()))
    revisions = revision, await map_revision(request)
    return told_anew(request, await in_thread(request, _scales, notes, revisions, known, *laid))


@OPERATIONS.add(
    "POST", f"{BASE}/scale", Reply("It is on the disk.", DistanceAnswer, 201), body=NewDistanceBody, failures=NO_NOTES
)
async def create(request: web.Request) -> web.StreamResponse:
    """Give two points of an island (canvas) and the metres between them."""
    asked, notes = await asked_body(request, NewDistanceBody), request.app[NOTES]
    ends = asked.from_, asked.to
    first, second = [await in_thread(request, notes.follower.bound, asked.island, *end) for end in ends]
    if metres_per_unit(notes.follower.place(first), notes.follower.place(second), asked.metres) is None:
        raise Unfit(f"from and to are to be {LEAST_UNITS:g} canvas unit apart at least, on one island.")
    known = await notes.run(notes.scales.create, (first, second), asked.metres, asked.who)
    return answer(await in_thread(request, _known, notes, known), 201)


@OPERATIONS.add("DELETE", ONE, Reply("It is deleted.", DistanceAnswer), failures=NO_NUMBER | NO_NOTES)
async def delete(request: web.Request) -> web.StreamResponse:
    """Delete; the one given before holds again."""
    return await _set_deleted(request, deleted=True)


@OPERATIONS.add("POST", f"{ONE}/restore", Reply("It holds again.", DistanceAnswer), failures=NO_NUMBER | NO_NOTES)
async def restore(request: web.Request) -> web.StreamResponse:
    """Undo a deletion."""
    return await _set_deleted(request, deleted=False)


async def _set_deleted(request: web.Request, *, deleted: bool) -> web.StreamResponse:
    notes, number = request.app[NOTES], id_of(request)
    known = await notes.run(lambda: notes.scales.set_deleted(number, deleted=deleted))
    return answer(await in_thread(request, _known, notes, known))


async def scales_of(request: web.Request) -> Mapping[int, IslandScale]:
    """Each island's scale by what is known of it now, as the page tells it."""
    notes = request.app[NOTES]
    (_, *laid), known = await notes.run(lambda: (notes.pinned(), notes.scales.all()))
    return await in_thread(request, _of_islands, notes, known, *laid)


def _of_islands(
    notes: Notes, known: Sequence[KnownDistance], pins: Sequence[SetPin], by_positions: bool
) -> Mapping[int, IslandScale]:
    return island_scales(known, notes.follower.place, anchored(notes.islands(pins, by_positions)))


def _scales(
    notes: Notes, revisions: tuple[int, int], known: Sequence[KnownDistance], pins: Sequence[SetPin], by_positions: bool
) -> ScaleAnswer:
    scales = _of_islands(notes, known, pins, by_positions)
    distances = [_known(notes, one) for one in known]
    revision, of_map = revisions
    return ScaleAnswer(revision=revision, map_revision=of_map, islands=list(scales.values()), distances=distances)


def _known(notes: Notes, one: KnownDistance) -> DistanceAnswer:
    first, second = (place_answer(end, notes.follower.place(end)) for end in one.ends)
    return DistanceAnswer(
        id=one.id, deleted=one.deleted, metres=one.metres, who=one.who, utc=one.utc, from_=first, to=second
    )
