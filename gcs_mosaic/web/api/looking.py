"""Looking, shared out among those who have the page open: patches, and second opinions on finds."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from aiohttp import web

from gcs_mosaic.notes.search.looking import LEAST_LOOK_S, LENT_S, MOST_SIDE, GroundPatch, Place
from gcs_mosaic.notes.search.opinions import FindOpinion, Opinion
from gcs_mosaic.notes.search.reviews import LONGEST_LOOK_S, ReviewedView
from gcs_mosaic.notes.search.seen_ground import IslandGround, StampedGround
from gcs_mosaic.notes.storage.checked import LONGEST_NAME, Who
from gcs_mosaic.render.tile_grid import FINEST_LEVEL
from gcs_mosaic.stitch.arrays import Mask
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView, FrameTable
from gcs_mosaic.web.api.asked import asked_body
from gcs_mosaic.web.api.common import BASE, SHOWN_S, VIEW, MapRevision, answer, in_thread, told_anew
from gcs_mosaic.web.api.finds import ONE
from gcs_mosaic.web.api.notes import NOTES, Canvas, IslandNumber, Notes, id_of
from gcs_mosaic.web.api.operations import NO_NOTES, NO_NUMBER, Operations, Reply

PATH = f"{BASE}/looking"
OPERATIONS = Operations()
COARSER = 1  # level than an island's finest at which a look counts: as the page shows what does not fit a small screen
MOST_NEAR = 1 << 16  # open cells that a patch is chosen from: sixteen times the largest patch
Edges = tuple[Canvas, Canvas, Canvas, Canvas]
Session = Annotated[str, Limits(longest=40), "of an open page, at random"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchWishBody:
    """A page that wants a patch, and whether it has looked at the one that it has."""

    session: Session
    island: IslandNumber
    columns: Annotated[int, Limits(least=1, most=MOST_SIDE), "cells that its screen holds at full sharpness"]
    lines: Annotated[int, Limits(least=1, most=MOST_SIDE)]
    level: Annotated[int, Limits(least=0, most=FINEST_LEVEL), "zoom at which the last patch was looked at"] = 0
    seconds: Annotated[float, Limits(least=0, most=LONGEST_LOOK_S), "that somebody looked at it"] = 0.0
    put_off: Annotated[bool, "look at the last patch later"] = False
    looked: Annotated[Edges | None, "box of the last patch as the page shows it; null: it has none"] = None
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionBody:
    """A page that has a patch."""

    session: Session
    who: Annotated[str, Limits(longest=LONGEST_NAME), "not needed"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LentPatch:
    """Ground that somebody is looking at."""

    who: Who
    island: IslandNumber
    box: Annotated[Edges, "left, top, right, bottom, on the island's canvas"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LookingAnswer:
    """What to look at next."""

    map_revision: MapRevision
    patch: Annotated[LentPatch | None, "null: all was looked at, or others have the rest"]
    counted: Annotated[bool, "whether the last patch counts as looked at: for a second at least, at full sharpness"]
    cells: Annotated[int, "of the island that were seen"]
    cut: Annotated[bool, "there is ground farther out that is in no patch: it is not in these figures"]
    left: Annotated[int, "of them that are to be looked at"]
    others: Annotated[Sequence[LentPatch], "what other pages have"]
    lent_s: Annotated[float, "for how long, unless it is asked for again"] = LENT_S


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptAnswer:
    """Whether the patch is still that page's."""

    kept: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class OpinionBody:
    """A second opinion on a find."""

    opinion: Opinion
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class OpinionsAnswer:
    """What others say of finds."""

    opinions: Sequence[FindOpinion]


@OPERATIONS.add("GET", f"{BASE}/opinions", Reply("The opinions.", OpinionsAnswer, tagged=True), failures=NO_NOTES)
async def opinions(request: web.Request) -> web.StreamResponse:
    """What others than those who set them say of finds."""
    notes = request.app[NOTES]
    return told_anew(request, OpinionsAnswer(opinions=await notes.run(notes.opinions.all)))


@OPERATIONS.add(
    "POST",
    f"{ONE}/opinions",
    Reply("It is on the disk.", OpinionsAnswer),
    body=OpinionBody,
    failures=NO_NUMBER | NO_NOTES,
)
async def say(request: web.Request) -> web.StreamResponse:
    """Give a second opinion on a find, by name; once more changes it."""
    asked, notes = await asked_body(request, OpinionBody), request.app[NOTES]
    await notes.run(notes.opinions.say, id_of(request), asked.who, asked.opinion)
    return answer(OpinionsAnswer(opinions=await notes.run(notes.opinions.all)))


@OPERATIONS.add("POST", PATH, Reply("The patch is lent.", LookingAnswer), body=PatchWishBody, failures=NO_NOTES)
async def looking(request: web.Request) -> web.StreamResponse:
    """Take in how long a page's patch was looked at, and lend it the next."""
    asked, notes, view = await asked_body(request, PatchWishBody), request.app[NOTES], request.app[VIEW]
    table, ground = await in_thread(request, _seen, view, notes.ground, asked.island)
    return answer(await notes.run(_next, notes, asked, table, ground))


@OPERATIONS.add("POST", f"{PATH}/keep", Reply("Told.", KeptAnswer), body=SessionBody, failures=NO_NOTES)
async def keep(request: web.Request) -> web.StreamResponse:
    """Keep the patch of a page for longer."""
    asked, notes = await asked_body(request, SessionBody), request.app[NOTES]
    return answer(KeptAnswer(kept=await notes.run(notes.looking.keep, asked.session)))


@OPERATIONS.add("POST", f"{PATH}/leave", Reply("It is given back.", KeptAnswer), body=SessionBody, failures=NO_NOTES)
async def leave(request: web.Request) -> web.StreamResponse:
    """Give the patch of a page back."""
    asked, notes = await asked_body(request, SessionBody), request.app[NOTES]
    await notes.run(notes.looking.give_back, asked.session)
    return answer(KeptAnswer(kept=False))


def _seen(view: FlightView, grounds: IslandGround, island: int) -> tuple[FrameTable, StampedGround]:
    """An island's ground that is on the map by now."""
    table = view.table()
    return table, grounds.of(table, island, time.monotonic() - SHOWN_S)


def _next(notes: Notes, asked: PatchWishBody, table: FrameTable, ground: StampedGround) -> LookingAnswer:
    finest = max((one.level for one in table.frames if one.island == asked.island), default=FINEST_LEVEL)
    least = max(0, finest - COARSER)
    before = notes.looking.looked(asked.session)
    # Where an answer was lost the page still shows what it had before, and has never shown what is lent to it.
    is_shown = before is not None and (before.island, before.box) == (asked.island, asked.looked)
    counted = is_shown and not asked.put_off and _counts(notes, asked, before, least)
    is_open = notes.reviews.open_in(ground, asked.island, least)
    place = Place(
        session=asked.session,
        who=asked.who,
        island=asked.island,
        columns=asked.columns,
        lines=asked.lines,
        put_off=asked.put_off and is_shown,
    )
    patch = notes.looking.next(place, _nearest(ground, is_open, notes.looking.at(place, before)))
    if patch is not None and (patch != before or counted or notes.looking.noted(asked.session) is None):
        notes.looking.note(asked.session, ground.within(patch.cells()))
    others = [one for one in notes.looking.lent() if one.session != asked.session and one.island == asked.island]
    return LookingAnswer(
        map_revision=table.revision,
        patch=None if patch is None else _told(patch),
        counted=counted,
        cells=int(np.count_nonzero(ground.stamps)),
        cut=ground.is_cut,
        left=int(np.count_nonzero(is_open)),
        others=[_told(one) for one in others],
    )


def _counts(notes: Notes, asked: PatchWishBody, patch: GroundPatch | None, least: int) -> bool:
    """Take in a look, for what the patch showed when it was lent: what was painted since may not have been seen."""
    stamps = notes.looking.noted(asked.session)
    if patch is None or stamps is None or asked.seconds < LEAST_LOOK_S or asked.level < least:
        return False
    notes.reviews.report(ReviewedView(patch.island, patch.box, asked.level, asked.seconds, asked.who, stamps))
    return True


def _nearest(ground: StampedGround, is_open: Mask, at: tuple[int, int] | None) -> set[tuple[int, int]]:
    """The open cells; of very many those of the lines nearest to a cell."""
    lines, columns = np.nonzero(is_open)
    if len(lines) > MOST_NEAR:
        apart = np.abs(lines + ground.y - (0 if at is None else at[1]))
        kept = np.argsort(apart, kind="stable")[:MOST_NEAR]
        lines, columns = lines[kept], columns[kept]
    return set(zip((columns + ground.x).tolist(), (lines + ground.y).tolist(), strict=True))


def _told(patch: GroundPatch) -> LentPatch:
    return LentPatch(who=patch.who, island=patch.island, box=patch.box)
