"""Of the flight as a whole."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Literal, cast

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.common import BASE, VIEW, MapRevision, answer, in_thread, map_revision, told_anew
from gcs_mosaic.web.api.openapi import description
from gcs_mosaic.web.api.operations import DECLARED, Operations, Reply

logger = logging.getLogger(__name__)

ABSENT = "The newest 500 frames and the newest 500 shots without a picture."
OPERATIONS = Operations()

OffTheMap = Literal["waiting", "rejected", "damaged", "dropped", "unstitched", "missing"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightAnswer:
    """Versions, and what the flight has come to."""

    api: int
    program: str
    revision: int
    frames: Annotated[int, "on the map"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AbsentAnswer:
    """Shots that are not on the map."""

    map_revision: MapRevision
    absent: Sequence[AbsentShotAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class AbsentShotAnswer:
    """A shot that is not on the map."""

    name: Annotated[str, "of the frame, or of the file that was announced; may be empty"]
    state: OffTheMap
    reason: str
    island: int | None
    place: Annotated[tuple[float, float] | None, "on the island's canvas"]


@OPERATIONS.add("GET", BASE, Reply("The flight.", FlightAnswer))
async def about(request: web.Request) -> web.StreamResponse:
    """Versions, and what the flight has come to."""
    table = await in_thread(request, request.app[VIEW].table)
    return answer(FlightAnswer(api=1, program=_program(), revision=table.revision, frames=len(table.frames)))


@OPERATIONS.add("GET", f"{BASE}/absent", Reply(ABSENT, AbsentAnswer, tagged=True))
async def absent(request: web.Request) -> web.StreamResponse:
    """Shots that are not on the map, why, and where they should be: between those that were taken just before and after."""
    revision = await map_revision(request)
    try:
        shots = await in_thread(request, _absent, request.app[VIEW])
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        shots = []
    return told_anew(request, AbsentAnswer(map_revision=revision, absent=shots))


@OPERATIONS.add("GET", f"{BASE}/openapi.json", Reply("OpenAPI 3.1.", dict, tagged=True))
async def described(request: web.Request) -> web.StreamResponse:
    """This description."""
    return told_anew(request, await in_thread(request, description, request.app[DECLARED]))


def _absent(view: FlightView) -> list[AbsentShotAnswer]:
    """Raises UsageError."""
    from gcs_mosaic.views.absent import absent_shots  # it loads what paints, which a page that nobody asks does without

    return [
        AbsentShotAnswer(
            name=one.name.encode("utf-8", "replace").decode(),
            state=cast("OffTheMap", one.state),
            reason=one.reason,
            island=one.island,
            place=None if one.place is None else (round(one.place[0], 1), round(one.place[1], 1)),
        )
        for one in absent_shots(view)
    ]


def _program() -> str:
    try:
        return version("gcs-mosaic")
    except PackageNotFoundError:  # from a folder that was never installed
        return "unknown"
