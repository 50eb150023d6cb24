"""Hints: what may be worth a look, and the colours that are sought."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from aiohttp import web

from gcs_mosaic.hints.hint_file import read_hints
from gcs_mosaic.hints.hint_places import hint_places
from gcs_mosaic.hints.ranking import RankedHint, Reason, ranked
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.notes.search.dismissed_hints import HintKey
from gcs_mosaic.notes.search.hint_wishes import PickedColour
from gcs_mosaic.notes.storage.checked import LONGEST_LABEL, Unfit, Utc, Who
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import NoPicture, displayed
from gcs_mosaic.views.sightings import sightings
from gcs_mosaic.web.api.asked import asked_body
from gcs_mosaic.web.api.common import BASE, VIEW, MapRevision, answer, in_thread, steadily, told_anew
from gcs_mosaic.web.api.notes import NOTES, PlacedBody, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Operations, Reply
from gcs_mosaic.web.hint_keeper import HintKeeper, State

PATH = f"{BASE}/hints"
COLOURS = f"{PATH}/colours"
ONE_COLOUR = COLOURS + r"/{id:[0-9]{1,9}}"
AROUND = 1  # px about the picked one, of which the median is taken
MOST_SHOWN = 500
WISHES_S = 2.0  # between looks at what other programs have written to the notes

SAME_S = 1.5  # for which an answer is the same for all pages
KEEPER = web.AppKey("hint_keeper", HintKeeper)


Byte = Annotated[int, Limits(least=0, most=255)]
Rgb = tuple[Byte, Byte, Byte]
OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class HintAnswer:
    """What may be worth a look."""

    hint: HintKey
    reason: Reason
    what: Annotated[int, "id of the picked colour, or the detector's class"]
    worth: Annotated[float, "how odd it is (-log10 of a share of pixels), how alike or how sure (0 to 1)"]
    utc: Annotated[Utc, "when it was found first, seconds since 1970"]
    island: int | None
    place: Annotated[tuple[float, float] | None, "on the island's canvas"]
    frame: Annotated[int, "where it is seen best"]
    name: Annotated[str, "of the frame"]
    pixel: Annotated[tuple[float, float], "middle, in the original"]
    size: Annotated[tuple[float, float], "width and height, pixels of the original"]
    seen: Annotated[int, "frames in which it was found"]
    looks: Annotated[int, "other looks at the place that were compared"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PickedColourAnswer:
    """A colour that is sought."""

    id: int
    rgb: Rgb
    tolerance: float
    label: str
    who: Who
    utc: Utc


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundHints:
    """What is to be shown now."""

    map_revision: int
    searched: int
    failed: int
    frames: int
    hints: Sequence[HintAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class HintsAnswer:
    """Whether hints are sought, how far that has come, and what was found."""

    map_revision: MapRevision
    on: bool
    state: State
    trouble: Annotated[str, "in a sentence; empty for none"]
    searched: Annotated[int, "frames"]
    failed: Annotated[int, "frames that could not be searched"]
    frames: Annotated[int, "frames on the map"]
    hints: Annotated[Sequence[HintAnswer], "the oddest first"]
    colours: Sequence[PickedColourAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchBody:
    """Whether hints are sought."""

    on: bool
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchedAnswer:
    """Whether hints are sought."""

    on: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourBody(PlacedBody):
    """A colour to be sought: given, or that of a place."""

    rgb: Annotated[Rgb | None, "instead of a place"] = None
    tolerance: Annotated[float, Limits(least=2.0, most=80.0), "distance in CIE L*a*b* of 8 bits"] = 18.0
    label: Annotated[str, Limits(longest=LONGEST_LABEL)] = ""
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourIdAnswer:
    """The colour."""

    id: int


class ShownHints:
    """What is to be shown now, worked out once for all pages that ask. Thread-safe."""

    def __init__(self, view: FlightView, settings: HintSettings) -> None:
        self._view, self._settings = view, settings
        self._lock = threading.Lock()
        self._last: tuple[float, Collection[str], FoundHints | None] = -SAME_S, (), None

    def now(self, dismissed: Collection[str]) -> FoundHints:
        with self._lock:
            then, without, told = self._last
            if told is None or time.monotonic() - then > SAME_S or without != dismissed:
                told = _shown(self._view, self._settings, dismissed)
                self._last = time.monotonic(), dismissed, told
            return told


SHOWN = web.AppKey("shown_hints", ShownHints)


def add_hints(app: web.Application, settings: HintSettings) -> None:
    """Seek hints as long as the application runs and somebody wants them."""
    app[SHOWN], app[KEEPER] = ShownHints(app[VIEW], settings), HintKeeper(app[VIEW].root, settings)
    app.cleanup_ctx.append(_kept)


@OPERATIONS.add("GET", PATH, Reply("The hints, where they lie now.", HintsAnswer, tagged=True), failures=NO_NOTES)
async def every(request: web.Request) -> web.StreamResponse:
    """Whether hints are sought, how far that has come, and what may be worth a look, the oddest first."""
    notes, keeper = request.app[NOTES], request.app[KEEPER]
    colours, dismissed = await notes.run(lambda: (notes.hint_wishes.colours(), notes.dismissed.all()))
    found = await in_thread(request, request.app[SHOWN].now, {one.hint for one in dismissed})
    told = HintsAnswer(
        map_revision=found.map_revision,
        on=keeper.is_asked,
        state=keeper.state,
        trouble=keeper.trouble,
        searched=found.searched,
        failed=found.failed,
        frames=found.frames,
        hints=found.hints,
        colours=[_colour(one) for one in colours],
    )
    return told_anew(request, told)


@OPERATIONS.add("POST", PATH, Reply("It is so.", SwitchedAnswer), body=SwitchBody, failures=NO_NOTES)
async def switch(request: web.Request) -> web.StreamResponse:
    """Seek hints, or do not, for everybody."""
    asked, notes = await asked_body(request, SwitchBody), request.app[NOTES]
    await notes.run(lambda: notes.hint_wishes.ask(asked.who, asked=asked.on))
    await _pass_on(request.app)
    return answer(SwitchedAnswer(on=asked.on))


@OPERATIONS.add("POST", COLOURS, Reply("It is sought.", PickedColourAnswer, 201), body=ColourBody, failures=NO_NOTES)
async def pick(request: web.Request) -> web.StreamResponse:
    """Seek a colour everywhere: given, or that of a place of the map or of an original."""
    asked, notes = await asked_body(request, ColourBody), request.app[NOTES]
    bgr = await in_thread(request, _colour_asked, request.app[VIEW], asked)
    picked = await notes.run(notes.hint_wishes.pick, bgr, asked.tolerance, asked.label, asked.who)
    await _pass_on(request.app)
    return answer(_colour(picked), 201)


@OPERATIONS.add(
    "DELETE", ONE_COLOUR, Reply("It is not sought any more.", ColourIdAnswer), failures=NO_NUMBER | NO_NOTES
)
async def take_away(request: web.Request) -> web.StreamResponse:
    """Seek a colour no more."""
    notes, number = request.app[NOTES], id_of(request)
    await notes.run(notes.hint_wishes.take_away, number)
    await _pass_on(request.app)
    return answer(ColourIdAnswer(id=number))


async def _kept(app: web.Application) -> AsyncIterator[None]:
    app[KEEPER].start()
    task = asyncio.create_task(_pass_on_for_ever(app))
    yield
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    await asyncio.to_thread(app[KEEPER].stop)


async def _pass_on_for_ever(app: web.Application) -> None:
    async def step() -> bool:
        with suppress(web.HTTPServiceUnavailable):
            await _pass_on(app)
        return False

    await steadily(step, WISHES_S)


async def _pass_on(app: web.Application) -> None:
    """What people want, to who keeps the process."""
    wishes = app[NOTES].hint_wishes
    app[KEEPER].wish(*await app[NOTES].run(lambda: (wishes.asked, wishes.colours())))


def _shown(view: FlightView, settings: HintSettings, dismissed: Collection[str]) -> FoundHints:
    read, table = read_hints(view.root), view.table()
    times = [frame.modified for frame in table.frames if frame.modified is not None]
    minutes = (max(times) - min(times)) / 60 if times else 0.0
    places = hint_places(view, read.hints)
    shown = ranked(read, places, settings.per_minute, minutes, dismissed)[:MOST_SHOWN]
    names = {frame.number: frame.name for frame in table.frames}
    told = [_hint(one, read.key(one.hint), names) for one in shown]
    return FoundHints(
        map_revision=table.revision, searched=read.searched, failed=read.failed, frames=len(table.frames), hints=told
    )


def _hint(one: RankedHint, key: str, names: dict[int, str]) -> HintAnswer:
    found, place = one.hint.found, one.place
    return HintAnswer(
        hint=key,
        reason=one.reason,
        what=found.what,
        worth=round(one.worth, 2),
        utc=one.hint.utc,
        island=None if place is None else place.island,
        place=None if place is None else (round(place.x, 1), round(place.y, 1)),
        frame=found.frame,
        name=names.get(found.frame, "").encode("utf-8", "replace").decode(),
        pixel=(round(found.x, 1), round(found.y, 1)),
        size=(found.width, found.height),
        seen=found.seen,
        looks=found.verdict.looks,
    )


def _colour(one: PickedColour) -> PickedColourAnswer:
    blue, green, red = one.bgr
    return PickedColourAnswer(
        id=one.id, rgb=(red, green, blue), tolerance=one.tolerance, label=one.label, who=one.who, utc=one.utc
    )


def _colour_asked(view: FlightView, asked: ColourBody) -> tuple[int, int, int]:
    """Blue, green and red: given, of a pixel of an original, or of a place as the best look at it shows it. Raises Unfit."""
    if asked.rgb is not None:
        return asked.rgb[2], asked.rgb[1], asked.rgb[0]
    frame, (x, y) = _look_at(view, asked)
    try:
        picture = displayed(view, frame, 1)
    except NoPicture as error:
        raise Unfit(str(error)) from error
    return _median_about(picture, round(x), round(y))


def _look_at(view: FlightView, asked: ColourBody) -> tuple[int, tuple[float, float]]:
    """Frame and pixel of what is meant. Raises Unfit."""
    if asked.frame is not None:
        if asked.pixel is None:
            raise Unfit("pixel is to be two numbers.")
        return asked.frame, asked.pixel
    if asked.island is None or asked.x is None or asked.y is None:
        raise Unfit("rgb is to be given; or island, x and y; or frame and pixel.")
    seen = sightings(view, asked.island, asked.x, asked.y)
    if not seen:
        raise Unfit("No frame has seen that place.")
    return seen[0].number, (seen[0].x, seen[0].y)


def _median_about(picture: np.ndarray[Any, Any], x: int, y: int) -> tuple[int, int, int]:
    """Raises Unfit for a pixel outside."""
    if not (0 <= x < picture.shape[1] and 0 <= y < picture.shape[0]):
        raise Unfit("pixel is to be inside the frame.")
    around = picture[max(0, y - AROUND) : y + AROUND + 1, max(0, x - AROUND) : x + AROUND + 1].reshape(-1, 3)
    blue, green, red = (int(value) for value in np.median(around, axis=0))
    return blue, green, red
