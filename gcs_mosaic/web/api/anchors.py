"""Anchors: pins, whether positions may lay the map, and what coordinates a place has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.coordinates import decimal_text, dms_text, mgrs_text, read_coordinate, utm_text
from gcs_mosaic.geo.pins import USUAL_SIGMA_M, PinnedMap, Refused
from gcs_mosaic.geo.positions import PositionedMap
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor
from gcs_mosaic.notes.anchors.pins import NewPin, SetPin
from gcs_mosaic.notes.ground.places import PlaceAnswer, place_answer
from gcs_mosaic.notes.storage.checked import FURTHEST, LONGEST_LABEL, Unfit, Utc, Who
from gcs_mosaic.store.documents import Limits, told_of
from gcs_mosaic.web.api.asked import asked_body, asked_query
from gcs_mosaic.web.api.common import BASE, MapRevision, answer, in_thread, map_revision, told_anew
from gcs_mosaic.web.api.notes import NO_PLACE, NOTES, Canvas, IslandNumber, Notes, PlacedBody, bound, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Operations, Reply

PIN = BASE + r"/pins/{id:[0-9]{1,9}}"
OPERATIONS = Operations()

Label = Annotated[str, Limits(longest=LONGEST_LABEL)]
Text = Annotated[str, Limits(longest=100, lines=True), "decimal degrees, degrees-minutes-seconds, UTM or MGRS"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipse:
    """95 % of errors lie within."""

    major_m: float
    minor_m: float
    bearing_deg: Annotated[float, "of the longer axis, clockwise from north"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinateAnswer:
    """A place on earth (WGS 84), in all notations."""

    longitude: Annotated[float, "degrees"]
    latitude: Annotated[float, "degrees"]
    decimal: str
    dms: str
    utm: Annotated[str | None, "null near the poles"]
    mgrs: Annotated[str | None, "null near the poles"]
    error_m: Annotated[float, "95 % of errors are smaller"]
    ellipse: Ellipse


@dataclass(frozen=True, slots=True, kw_only=True)
class MiddleAnswer(CoordinateAnswer):
    """The middle of what an anchor was made of."""

    x: Annotated[float, "on the island's canvas"]
    y: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorAnswer:
    """How an island lies on earth."""

    metres_per_unit: Annotated[float, "of the canvas"]
    north_deg: Annotated[float, "clockwise from up"]
    middle: MiddleAnswer


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedIsland:
    """An island that has no anchor."""

    island: int
    by: Literal["pins", "positions"]
    pins: Annotated[Sequence[int], "ids of those on it"]
    refused: Annotated[str, "why there is none, and what to do"]
    anchor: None


@dataclass(frozen=True, slots=True, kw_only=True)
class PinnedIsland:
    """An island that is laid by pins."""

    island: int
    by: Literal["pins"]
    pins: Annotated[Sequence[int], "ids of those on it"]
    refused: None
    anchor: AnchorAnswer
    checked: Annotated[bool, "whether more is known than it takes, and agrees"]
    fits: bool
    misfit: Annotated[str | None, "the first pin that does not fit"]
    misfits: Annotated[Sequence[str], "all points that do not fit and are left out, by the names of their pins"]
    points: Annotated[int, "pins, of which near ones count as one"]
    if_right_m: Annotated[float, "the error in the middle (95 %) if all coordinates are as exact as is said"]
    residuals_m: Annotated[Sequence[float], "of the pins, in their order"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionedIsland:
    """An island that is laid by the positions of the triggers."""

    island: int
    by: Literal["positions"]
    pins: Annotated[Sequence[int], "ids of those on it"]
    refused: None
    anchor: AnchorAnswer
    checked: bool
    lag_s: Annotated[float, "how long after the shutter a position is measured"]
    sigma_m: Annotated[float, "of one position, in each direction"]
    residual_m: Annotated[float, "median"]
    shots: int
    outliers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PinAnswer(PlaceAnswer):
    """A place whose coordinate somebody has said."""

    id: int
    deleted: bool
    label: Label
    written: Annotated[str, "as it was typed; empty for longitude and latitude"]
    longitude: Annotated[float, "degrees"]
    latitude: Annotated[float, "degrees"]
    sigma_m: Annotated[float, "one standard deviation of the coordinate"]
    who: Who
    utc: Utc


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorsAnswer:
    """How each island lies on earth, and the pins."""

    revision: int
    map_revision: MapRevision
    by_positions: Annotated[bool, "whether positions may lay islands that have no pins"]
    islands: Sequence[RefusedIsland | PinnedIsland | PositionedIsland]
    pins: Sequence[PinAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionsBody:
    """Whether positions may lay the map."""

    asked: bool
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class ByPositionsAnswer:
    """Whether positions may lay the map."""

    by_positions: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class NewPinBody(PlacedBody):
    """A place and its coordinate, as text or as longitude and latitude."""

    coordinate: Text = ""
    longitude: Annotated[float | None, Limits(least=-180, most=180), "degrees"] = None
    latitude: Annotated[float | None, Limits(least=-90, most=90), "degrees"] = None
    sigma_m: Annotated[float, Limits(least=0.01, most=1000.0), "one standard deviation"] = USUAL_SIGMA_M
    label: Label = ""
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinatesQuery:
    """A canvas place."""

    island: IslandNumber
    x: Canvas
    y: Canvas


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinatesAnswer:
    """The coordinate of a canvas place."""

    island: int
    place: Annotated[CoordinateAnswer | None, "null where the island has no anchor"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CanvasQuery:
    """A coordinate."""

    at: Text


@dataclass(frozen=True, slots=True, kw_only=True)
class CanvasSpot:
    """A place on an island's canvas."""

    island: int
    x: float
    y: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CanvasAnswer:
    """A coordinate, and where it lies on the islands that have an anchor."""

    longitude: Annotated[float, "degrees"]
    latitude: Annotated[float, "degrees"]
    places: Sequence[CanvasSpot]


@OPERATIONS.add("GET", f"{BASE}/anchors", Reply("The anchors.", AnchorsAnswer, tagged=True), failures=NO_NOTES)
async def every(request: web.Request) -> web.StreamResponse:
    """How each island lies on earth, or why it does not, and the pins."""
    notes = request.app[NOTES]
    (revision, pins, by_positions), of_map = await notes.run(notes.pinned), await map_revision(request)
    islands = await in_thread(request, notes.islands, pins, by_positions)
    told = AnchorsAnswer(
        revision=revision,
        map_revision=of_map,
        by_positions=by_positions,
        islands=[_island(one) for _, one in sorted(islands.items())],
        pins=[_pin(notes, pin) for pin in pins],
    )
    return told_anew(request, told)


@OPERATIONS.add(
    "PUT",
    f"{BASE}/anchors/positions",
    Reply("As it is kept.", ByPositionsAnswer),
    body=PositionsBody,
    failures=NO_NOTES,
)
async def ask_for_positions(request: web.Request) -> web.StreamResponse:
    """Let the triggers' positions lay islands that have no pins, or not."""
    told, notes = await asked_body(request, PositionsBody), request.app[NOTES]
    await notes.run(lambda: notes.pins.ask_for_positions(told.who, asked=told.asked))
    return answer(ByPositionsAnswer(by_positions=told.asked))


@OPERATIONS.add("POST", f"{BASE}/pins", Reply("It is on the disk.", PinAnswer, 201), body=NewPinBody, failures=NO_NOTES)
async def create(request: web.Request) -> web.StreamResponse:
    """Say the coordinate of a place of the map (island, x, y), or of an original's pixel (frame, pixel)."""
    told, notes = await asked_body(request, NewPinBody), request.app[NOTES]
    longitude, latitude, least_m = _coordinate(told)
    binding = await bound(request, told)
    if binding is None:
        raise Unfit(NO_PLACE)
    new = NewPin(
        label=told.label,
        written=" ".join(told.coordinate.split()),
        longitude_deg=longitude,
        latitude_deg=latitude,
        sigma_m=max(told.sigma_m, least_m),
        who=told.who,
        binding=binding,
    )
    pin = await notes.run(notes.pins.create, new)
    return answer(await in_thread(request, _pin, notes, pin), 201)


@OPERATIONS.add("DELETE", PIN, Reply("The pin.", PinAnswer), failures=NO_NUMBER | NO_NOTES)
async def delete(request: web.Request) -> web.StreamResponse:
    """Delete a pin, which lays nothing any more; it can be restored."""
    return await _set_deleted(request, deleted=True)


@OPERATIONS.add("POST", f"{PIN}/restore", Reply("The pin.", PinAnswer), failures=NO_NUMBER | NO_NOTES)
async def restore(request: web.Request) -> web.StreamResponse:
    """Undo a deletion."""
    return await _set_deleted(request, deleted=False)


@OPERATIONS.add(
    "GET",
    f"{BASE}/coordinates",
    Reply("The coordinate.", CoordinatesAnswer, tagged=True),
    query=CoordinatesQuery,
    failures=NO_NOTES,
)
async def coordinates(request: web.Request) -> web.StreamResponse:
    """The coordinate of a canvas place, in all notations, with its error."""
    asked = asked_query(request, CoordinatesQuery)
    laid = (await _laid(request)).get(asked.island)
    place = None if laid is None or laid.anchor is None else _place(laid.anchor, asked.x, asked.y)
    return told_anew(request, CoordinatesAnswer(island=asked.island, place=place))


@OPERATIONS.add(
    "GET",
    f"{BASE}/canvas",
    Reply("The places.", CanvasAnswer, tagged=True),
    query=CanvasQuery,
    failures=NO_NOTES,
)
async def canvas(request: web.Request) -> web.StreamResponse:
    """Where a coordinate lies on the islands that have an anchor."""
    try:
        at = read_coordinate(asked_query(request, CanvasQuery).at)
    except UsageError as error:
        raise Unfit(str(error)) from error
    laid = {island: one.anchor for island, one in (await _laid(request)).items() if one.anchor is not None}
    place = np.array([at.longitude_deg, at.latitude_deg])
    spots = {island: anchor.canvas(place) for island, anchor in laid.items()}
    shown = [
        CanvasSpot(island=island, x=float(x), y=float(y))
        for island, (x, y) in sorted(spots.items())
        if max(abs(x), abs(y)) <= FURTHEST
    ]
    return told_anew(request, CanvasAnswer(longitude=at.longitude_deg, latitude=at.latitude_deg, places=shown))


async def _laid(request: web.Request) -> Mapping[int, IslandAnchor]:
    notes = request.app[NOTES]
    _, pins, by_positions = await notes.run(notes.pinned)
    return await in_thread(request, notes.islands, pins, by_positions)


async def _set_deleted(request: web.Request, *, deleted: bool) -> web.StreamResponse:
    notes, number = request.app[NOTES], id_of(request)
    pin = await notes.run(lambda: notes.pins.set_deleted(number, deleted=deleted))
    return answer(await in_thread(request, _pin, notes, pin))


def _coordinate(told: NewPinBody) -> tuple[float, float, float]:
    """Longitude and latitude that were sent, and the deviation (metres) of what their digits leave open. Raises Unfit."""
    if told.coordinate:
        try:
            found = read_coordinate(told.coordinate)
        except UsageError as error:
            raise Unfit(str(error)) from error
        return found.longitude_deg, found.latitude_deg, found.least_sigma_m
    if told.longitude is None or told.latitude is None:
        raise Unfit("coordinate is to be given, or longitude and latitude.")
    return told.longitude, told.latitude, 0.0


def _island(one: IslandAnchor) -> RefusedIsland | PinnedIsland | PositionedIsland:
    result, pins = one.result, [pin.id for pin in one.pins]
    if isinstance(result, Refused):
        return RefusedIsland(island=one.island, by=one.by, pins=pins, refused=result.reason, anchor=None)
    if isinstance(result, PinnedMap):
        return _by_pins(one.island, pins, result)
    return _by_positions(one.island, pins, result)


def _by_pins(island: int, pins: Sequence[int], result: PinnedMap) -> PinnedIsland:
    return PinnedIsland(
        island=island,
        by="pins",
        pins=pins,
        refused=None,
        anchor=_anchor(result.anchor),
        checked=result.is_checked,
        fits=result.fits,
        misfit=result.misfit,
        misfits=result.misfits,
        points=result.points,
        if_right_m=result.if_right_m,
        residuals_m=result.residuals_m,
    )


def _by_positions(island: int, pins: Sequence[int], result: PositionedMap) -> PositionedIsland:
    return PositionedIsland(
        island=island,
        by="positions",
        pins=pins,
        refused=None,
        anchor=_anchor(result.anchor),
        checked=True,
        lag_s=result.lag_s,
        sigma_m=result.sigma_m,
        residual_m=result.residual_m,
        shots=result.shots,
        outliers=result.outliers,
    )


def _anchor(anchor: Anchor) -> AnchorAnswer:
    x, y = anchor.middle.real, -anchor.middle.imag
    middle = MiddleAnswer(x=x, y=y, **told_of(_place(anchor, x, y)))
    return AnchorAnswer(metres_per_unit=anchor.metres_per_unit, north_deg=anchor.north_deg, middle=middle)


def _place(anchor: Anchor, x: float, y: float) -> CoordinateAnswer:
    """Raises Unfit."""
    longitude, latitude = map(float, anchor.places(np.array([x, y])))
    if not math.isfinite(longitude):
        raise Unfit("That place is too far from what the anchor was made of.")
    error = anchor.error(x, y)
    return CoordinateAnswer(
        longitude=longitude,
        latitude=latitude,
        decimal=decimal_text(longitude, latitude),
        dms=dms_text(longitude, latitude),
        utm=utm_text(longitude, latitude),
        mgrs=mgrs_text(longitude, latitude),
        error_m=error.major_m,
        ellipse=Ellipse(major_m=error.major_m, minor_m=error.minor_m, bearing_deg=error.bearing_deg),
    )


def _pin(notes: Notes, pin: SetPin) -> PinAnswer:
    new = pin.pin
    at = place_answer(new.binding, notes.follower.place(new.binding))
    return PinAnswer(
        id=pin.id,
        deleted=pin.deleted,
        label=new.label,
        written=new.written,
        longitude=new.longitude_deg,
        latitude=new.latitude_deg,
        sigma_m=new.sigma_m,
        who=new.who,
        utc=pin.utc,
        island=at.island,
        x=at.x,
        y=at.y,
        frame=at.frame,
        follows=at.follows,
    )
