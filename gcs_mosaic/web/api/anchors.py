"""Anchors: pins, whether positions may lay the map, and what coordinates a place has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.coordinates import decimal_text, dms_text, mgrs_text, read_coordinate, utm_text
from gcs_mosaic.geo.pins import USUAL_SIGMA_M, PinnedMap, Refused
from gcs_mosaic.geo.positions import PositionedMap
from gcs_mosaic.notes.anchoring import IslandAnchor
from gcs_mosaic.notes.binding import Binding
from gcs_mosaic.notes.checked import FURTHEST, LONGEST_LABEL, Unfit, number_of, point_of, text_of, whole_of
from gcs_mosaic.notes.pins import NewPin, SetPin
from gcs_mosaic.notes.told import place_document
from gcs_mosaic.web.api.common import BASE, answer, body_of, in_thread
from gcs_mosaic.web.api.notes import (
    NOTES,
    Notes,
    asked_island,
    asked_number,
    id_of,
    island_of,
    reading,
    told_anew,
    who_of,
    writing,
)

PIN = BASE + r"/pins/{id:[0-9]{1,9}}"
SIGMAS_M = (0.01, 1000.0)
LONGEST_COORDINATE = 100


def add_routes(app: web.Application) -> None:
    app.router.add_get(f"{BASE}/anchors", reading(every))
    app.router.add_put(f"{BASE}/anchors/positions", writing(ask_for_positions))
    app.router.add_post(f"{BASE}/pins", writing(create))
    app.router.add_delete(PIN, writing(delete))
    app.router.add_post(f"{PIN}/restore", writing(restore))
    app.router.add_get(f"{BASE}/coordinates", reading(coordinates))
    app.router.add_get(f"{BASE}/canvas", reading(canvas))


async def every(request: web.Request) -> web.StreamResponse:
    """GET: how each island is laid on earth, or why it is not, and the pins."""
    notes = request.app[NOTES]
    revision, pins, by_positions = await notes.run(notes.pinned)
    islands = await in_thread(request, notes.islands, pins, by_positions)
    told = [_island(one) for _, one in sorted(islands.items())]
    shown = [_pin(notes, pin) for pin in pins]
    return told_anew(request, {"revision": revision, "by_positions": by_positions, "islands": told, "pins": shown})


async def ask_for_positions(request: web.Request) -> web.StreamResponse:
    """PUT: whether the positions of the triggers lay islands that have no pins."""
    told, notes = await body_of(request), request.app[NOTES]
    asked, who = told.get("asked"), who_of(told.get("who"))
    if not isinstance(asked, bool):
        raise Unfit("asked is to be true or false.")
    await notes.run(lambda: notes.pins.ask_for_positions(who, asked=asked))
    return answer({"by_positions": asked})


async def create(request: web.Request) -> web.StreamResponse:
    """POST: a place (island, x, y; or frame, pixel) and its coordinate, as text or as longitude and latitude."""
    told, notes = await body_of(request), request.app[NOTES]
    written, longitude, latitude, least_m = _coordinate(told)
    sigma = max(number_of(told.get("sigma_m", USUAL_SIGMA_M), "sigma_m", *SIGMAS_M), least_m)
    label, who = text_of(told.get("label"), "label", LONGEST_LABEL), who_of(told.get("who"))
    binding = await _binding(request, told)
    new = NewPin(
        label=label,
        written=written,
        longitude_deg=longitude,
        latitude_deg=latitude,
        sigma_m=sigma,
        who=who,
        binding=binding,
    )
    pin = await notes.run(notes.pins.create, new)
    return web.json_response(await in_thread(request, _pin, notes, pin), status=201)


async def delete(request: web.Request) -> web.StreamResponse:
    """DELETE: the pin lays nothing any more; can be restored."""
    return await _set_deleted(request, deleted=True)


async def restore(request: web.Request) -> web.StreamResponse:
    """POST: undo a deletion."""
    return await _set_deleted(request, deleted=False)


async def coordinates(request: web.Request) -> web.StreamResponse:
    """GET: the coordinate of a canvas place (island, x, y), in all notations, with its error."""
    island = asked_island(request)
    x, y = (asked_number(request, name, -FURTHEST, FURTHEST) for name in ("x", "y"))
    laid = (await _laid(request)).get(island)
    anchor = None if laid is None else laid.anchor
    return told_anew(request, {"island": island, "place": None if anchor is None else _place(anchor, x, y)})


async def canvas(request: web.Request) -> web.StreamResponse:
    """GET: where a coordinate (at=) lies on each island that has an anchor."""
    try:
        at = read_coordinate(request.query.get("at", ""))
    except UsageError as error:
        raise Unfit(str(error)) from error
    laid = {island: one.anchor for island, one in (await _laid(request)).items() if one.anchor is not None}
    place = np.array([at.longitude_deg, at.latitude_deg])
    spots = {island: anchor.canvas(place) for island, anchor in laid.items()}
    shown = [
        {"island": island, "x": float(x), "y": float(y)}
        for island, (x, y) in sorted(spots.items())
        if max(abs(x), abs(y)) <= FURTHEST
    ]
    return told_anew(request, {"longitude": at.longitude_deg, "latitude": at.latitude_deg, "places": shown})


async def _laid(request: web.Request) -> Mapping[int, IslandAnchor]:
    notes = request.app[NOTES]
    _, pins, by_positions = await notes.run(notes.pinned)
    return await in_thread(request, notes.islands, pins, by_positions)


async def _set_deleted(request: web.Request, *, deleted: bool) -> web.StreamResponse:
    notes, number = request.app[NOTES], id_of(request)
    pin = await notes.run(lambda: notes.pins.set_deleted(number, deleted=deleted))
    return answer(await in_thread(request, _pin, notes, pin))


async def _binding(request: web.Request, told: dict[str, Any]) -> Binding:
    follower = request.app[NOTES].follower
    if told.get("frame") is not None:
        number = whole_of(told["frame"], "frame", 0, 1 << 53)
        found = await in_thread(request, follower.bound_to_pixel, number, *point_of(told.get("pixel"), "pixel"))
        if found is None:
            raise Unfit("That frame is not on the map, or has no such pixel.")
        return found
    x, y = point_of([told.get("x"), told.get("y")], "x, y", FURTHEST)
    return await in_thread(request, follower.bound, island_of(told.get("island")), x, y)


def _coordinate(told: dict[str, Any]) -> tuple[str, float, float, float]:
    """The text, longitude and latitude that were sent, and the deviation (metres) of what its digits leave open. Raises Unfit."""
    written = text_of(told.get("coordinate"), "coordinate", LONGEST_COORDINATE)
    if written:
        try:
            found = read_coordinate(written)
        except UsageError as error:
            raise Unfit(str(error)) from error
        return written, found.longitude_deg, found.latitude_deg, found.least_sigma_m
    longitude = number_of(told.get("longitude"), "longitude", -180, 180)
    return "", longitude, number_of(told.get("latitude"), "latitude", -90, 90), 0.0


def _island(one: IslandAnchor) -> dict[str, Any]:
    anchor, result = one.anchor, one.result
    told: dict[str, Any] = {"island": one.island, "by": one.by, "pins": [pin.id for pin in one.pins]}
    if isinstance(result, Refused) or anchor is None:
        return {**told, "refused": result.reason if isinstance(result, Refused) else None, "anchor": None}
    middle = anchor.middle.real, -anchor.middle.imag
    told["anchor"] = {
        "metres_per_unit": anchor.metres_per_unit,
        "north_deg": anchor.north_deg,
        "middle": {"x": middle[0], "y": middle[1], **_place(anchor, *middle)},
    }
    if isinstance(result, PinnedMap):
        return {**told, **_by_pins(result)}
    return {**told, **_by_positions(result)}


def _by_pins(result: PinnedMap) -> dict[str, Any]:
    return {
        "checked": result.is_checked,
        "fits": result.fits,
        "misfit": result.misfit,
        "points": result.points,
        "if_right_m": result.if_right_m,
        "residuals_m": list(result.residuals_m),
    }


def _by_positions(result: PositionedMap) -> dict[str, Any]:
    return {
        "checked": True,
        "lag_s": result.lag_s,
        "sigma_m": result.sigma_m,
        "residual_m": result.residual_m,
        "shots": result.shots,
        "outliers": result.outliers,
    }


def _place(anchor: Anchor, x: float, y: float) -> dict[str, Any]:
    longitude, latitude = map(float, anchor.places(np.array([x, y])))
    if not math.isfinite(longitude):
        raise Unfit("That place is too far from what the anchor was made of.")
    error = anchor.error(x, y)
    return {
        "longitude": longitude,
        "latitude": latitude,
        "decimal": decimal_text(longitude, latitude),
        "dms": dms_text(longitude, latitude),
        "utm": utm_text(longitude, latitude),
        "mgrs": mgrs_text(longitude, latitude),
        "error_m": error.major_m,
        "ellipse": {"major_m": error.major_m, "minor_m": error.minor_m, "bearing_deg": error.bearing_deg},
    }


def _pin(notes: Notes, pin: SetPin) -> dict[str, Any]:
    new = pin.pin
    return {
        "id": pin.id,
        "deleted": pin.deleted,
        "label": new.label,
        "written": new.written,
        "longitude": new.longitude_deg,
        "latitude": new.latitude_deg,
        "sigma_m": new.sigma_m,
        "who": new.who,
        "utc": pin.utc,
        **place_document(new.binding, notes.follower.place(new.binding)),
    }
