"""Would a person have been seen? A layer, and figures for what was flown and for any part of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, TypeVar

import cv2
import numpy as np
from aiohttp import web

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.detection.detections import ASKED_S, Detections, units_of_pixel
from gcs_mosaic.detection.model import WHOLE_PX
from gcs_mosaic.detection.persons import Clothes, Person, Posture
from gcs_mosaic.notes.storage.checked import FURTHEST, Unfit
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.stitch.arrays import PointsNx2
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.coverage import nearest_cells
from gcs_mosaic.views.layers import grid_of, is_possible, stops_of, tile_picture
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import BASE, VIEW, MapRevision, OneThread, answer, beside, in_thread, missing, steadily
from gcs_mosaic.web.api.layers import PLACE, TILES
from gcs_mosaic.web.api.operations import NO_NOTES, Media, Operations, Reply
from gcs_mosaic.web.api.scale import scales_of
from gcs_mosaic.web.tile_answer import tile_answer

OPERATIONS = Operations()
Result = TypeVar("Result")
By = Literal["anchor", "distance", "pixels"]
PAUSE_S = 0.3
MOST_WAITING = 32  # a browser asks for six tiles at once: five pages
COLOURS = cv2.COLORMAP_VIRIDIS
MOST_CORNERS = 200
NO_SCALE = (
    "How large the ground is, is not known: set two pins, give a known distance, or say how many pixels a person has."
)
GREY = "The pictures have one band: how a person stands out in them is not known, and nothing is stated."


@dataclass(frozen=True, slots=True, kw_only=True)
class PersonQuery:
    """Who is sought."""

    posture: Posture = "lying"
    clothes: Clothes = "blue"
    pixels: Annotated[
        float | None,
        Limits(least=WHOLE_PX, most=1000),
        "side of a square of the person's area in a usual original, where no scale is known",
    ] = None
    outline: Annotated[str, Limits(longest=6000), "x,y;x,y;... on the island's canvas: a part of it"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionAnswer:
    """Shares from 0 to 1; null where nothing can be said."""

    map_revision: MapRevision
    trouble: Annotated[str, "what is missing before anything can be said, in a sentence"]
    flown: Annotated[float | None, "of somebody anywhere inside the flown area, gaps included"] = None
    seen: Annotated[float | None, "of somebody anywhere on ground that was seen"] = None
    part: Annotated[float | None, "of somebody anywhere in the outline that was asked for, as far as it was flown"] = (
        None
    )
    covered: Annotated[
        float | None, "share of the flown area of which something is stated: these figures leave the rest out"
    ] = None
    leaves_unknown: Annotated[
        float | None,
        "share of the ground of which something is stated, but not whether leaves hide it, since no two looks tell: it is "
        "taken for as open as the rest, or, where nothing is known of the rest, for open",
    ] = None
    frames: int
    measured: Annotated[int, "of the frames: the others count for nothing yet"]
    person_px: Annotated[float | None, "side of a square of the person's area in a usual original"]
    by: Annotated[By | None, "what tells how large the ground is"]
    colours: Annotated[Sequence[str], "of the layer, from 0 to 1, as #rrggbb"]


@dataclass(frozen=True, slots=True)
class Sought:
    """Who is sought, and where; `side` of the person in canvas units, and how that is known."""

    island: int
    person: Person
    outline: PointsNx2 | None
    side: float | None
    by: By | None


class Measuring:
    """Measures frames, and makes maps of them, on a thread of its own: other questions do not wait for it. Frames are measured
    for as long as somebody asks."""

    def __init__(self, detections: Detections) -> None:
        self.detections = detections
        self._asked, self._was_asked = -ASKED_S, False
        self._thread = OneThread("detection", MOST_WAITING)

    def note_asked(self) -> None:
        """Somebody is looking."""
        self._asked = time.monotonic()

    async def run(self, work: Callable[..., Result], *given: Any) -> Result:
        """Run blocking work on that thread. Raises HTTPServiceUnavailable."""
        return await self._thread.run(work, *given)

    async def for_ever(self) -> None:
        await steadily(self._step, PAUSE_S)

    async def _step(self) -> bool:
        is_asked = time.monotonic() - self._asked < ASKED_S
        if self._was_asked and not is_asked:
            await self._thread.run_anyway(self.detections.forget_pictures)
        self._was_asked = is_asked
        return is_asked and await self._thread.run_anyway(self.detections.step)

    def end(self) -> None:
        self._thread.end()


MEASURING = web.AppKey("measuring", Measuring)


def add_detection(app: web.Application) -> None:
    """Tell how probably a person would have been seen, as long as the application runs."""
    app[MEASURING] = Measuring(Detections(app[VIEW], app[TILES].islands.of))
    app.cleanup_ctx.append(beside(lambda app: app[MEASURING].for_ever(), _ended))


async def _ended(app: web.Application) -> None:
    app[MEASURING].end()


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/detection",
    Reply("The probabilities: advice that clears no ground.", DetectionAnswer),
    query=PersonQuery,
    failures=NO_NOTES,
)
async def detection(request: web.Request) -> web.StreamResponse:
    """Whether a person would have been seen, by what is measured so far; asking has the frames measured."""
    asked = await _sought(request)
    measuring = request.app[MEASURING]
    measuring.note_asked()
    return answer(await measuring.run(_answer, request, asked))


@OPERATIONS.add(
    "GET",
    f"{BASE}/detection/{PLACE}.png",
    Reply("256 x 256 px with alpha.", Media(("image/png",)), tagged=True),
    query=PersonQuery,
    failures={404: "There is no such tile.", **NO_NOTES},
)
async def detection_tile(request: web.Request) -> web.StreamResponse:
    """A tile of the layer, transparent where nothing is known."""
    tile = Tile(*(int(request.match_info[name]) for name in "zxy"))
    if not is_possible(tile, FINEST_LEVEL):
        raise missing("There is no such tile.")
    asked = await _sought(request)
    measuring = request.app[MEASURING]
    measuring.note_asked()
    return tile_answer(request, await measuring.run(_tile, request, asked, tile))


async def _sought(request: web.Request) -> Sought:
    """What the address asks. Raises Unfit."""
    asked, island = asked_query(request, PersonQuery), int(request.match_info["island"])
    person, outline = Person(posture=asked.posture, clothes=asked.clothes), outline_of(asked.outline)
    if asked.pixels is not None:
        pixel = await in_thread(request, units_of_pixel, request.app[VIEW], island)
        side = None if pixel is None else asked.pixels * pixel
        return Sought(island, person, outline, side, None if side is None else "pixels")
    scale = (await scales_of(request)).get(island)
    if scale is None:
        return Sought(island, person, outline, None, None)
    return Sought(island, person, outline, person.side_m / scale.metres_per_unit, scale.source)


def _map(request: web.Request, asked: Sought) -> DetectionMap | None:
    if asked.side is None:
        return None
    return request.app[MEASURING].detections.of(asked.island, asked.person, asked.side)


def _answer(request: web.Request, asked: Sought) -> DetectionAnswer:
    view, found = request.app[VIEW], _map(request, asked)
    pixel = units_of_pixel(view, asked.island)
    told = DetectionAnswer(
        map_revision=view.table().revision if found is None else found.revision,
        trouble=NO_SCALE if asked.side is None else "",
        frames=0 if found is None else found.frames,
        measured=0 if found is None else found.measured,
        person_px=None if asked.side is None or pixel is None else round(asked.side / pixel, 1),
        by=asked.by,
        colours=stops_of(COLOURS),
    )
    if found is None or found.is_grey:
        return told if found is None else replace(told, trouble=GREY)
    if not found.is_seen.any():  # gaps alone are no figure
        return replace(told, trouble="".join(found.troubles[:1]))
    return replace(
        told,
        trouble="".join(found.troubles[:1]),
        covered=found.covered,
        leaves_unknown=found.leaves_unknown,
        flown=found.within(found.flown),
        seen=found.within(found.is_seen & found.flown),
        part=None if asked.outline is None else found.within(found.cells_in(asked.outline)),
    )


def _tile(request: web.Request, asked: Sought, tile: Tile) -> bytes | None:
    found = _map(request, asked)
    if found is None or found.is_grey:
        return None
    known, at = nearest_cells(found.grid, grid_of(tile))
    return tile_picture(COLOURS, np.where(known, found.probability[at], np.nan))


def outline_of(text: str) -> PointsNx2 | None:
    """Corners (n, 2) on the canvas. Raises Unfit."""
    if not text:
        return None
    try:
        corners = np.array([[float(value) for value in one.split(",")] for one in text.split(";")], np.float64)
    except ValueError:
        corners = np.empty(0)
    if corners.ndim != 2 or corners.shape[1:] != (2,) or not 3 <= len(corners) <= MOST_CORNERS:
        raise Unfit(f"outline is to be 3 to {MOST_CORNERS} corners: x,y;x,y;x,y.")
    if not (np.abs(corners) <= FURTHEST).all():  # NaN is not
        raise Unfit("outline has a corner that is on no canvas.")
    return corners
