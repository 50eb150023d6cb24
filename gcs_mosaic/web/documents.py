"""The documents in the flight's folder, as they lie there."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import os
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from aiohttp import web

from gcs_mosaic.store import inside
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.journal import JOURNAL_NAME, told_after
from gcs_mosaic.store.ledger_file import flight_at
from gcs_mosaic.store.reading import LARGEST_DOCUMENT
from gcs_mosaic.store.told_documents import JournalHead, MosaicDocument, PlacementsDocument, StatusDocument
from gcs_mosaic.web.access import is_local
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.operations import JsonLines, Operations, Reply
from gcs_mosaic.web.choosing import ROOT
from gcs_mosaic.web.hidden_paths import without_paths
from gcs_mosaic.web.tile_answer import tagged

logger = logging.getLogger(__name__)

STATUS = "status.json"
FLIGHT = "X-Flight"  # the same of two answers: they are of one flight
SMALL_BYTES = 1 << 20  # of a document that is answered from memory
CHUNK = 1 << 16  # bytes of a document in memory for each page that takes it
NOT_YET = {404: "It is not written yet."}

OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalQuery:
    """What is known already."""

    after: Annotated[int, Limits(least=0, most=10**18), "a revision; lines of later ones are answered"] = 0


@OPERATIONS.add("GET", "/mosaic.json", Reply("The map.", MosaicDocument, tagged=True, ranged=True), failures=NOT_YET)
@OPERATIONS.add(
    "GET", "/placements.json", Reply("Every frame.", PlacementsDocument, tagged=True, ranged=True), failures=NOT_YET
)
async def document(request: web.Request) -> web.StreamResponse:
    """The document as it lies in the flight's folder."""
    answered = await _document(request, request.app[ROOT] / request.path.lstrip("/"))
    if which := await asyncio.to_thread(_which_flight, request.app[ROOT] / LEDGER_NAME):
        answered.headers[FLIGHT] = which
    return answered


async def _document(request: web.Request, path: Path) -> web.StreamResponse:
    try:
        small = await asyncio.to_thread(small_document, path)
    except OSError:
        raise web.HTTPNotFound(text=f"{path.name} is not written yet.\n") from None
    if small is None:
        return web.FileResponse(path, CHUNK, headers={"Content-Type": "application/json"})
    data, etag = small
    return tagged(request, data, "application/json", etag)


def _which_flight(ledger: Path) -> str:
    """What tells flights of one name apart for an open page, as those of two days in `mosaic` are; empty if that is not known."""
    try:
        found = ledger.stat()
    except OSError:  # gone or unreadable: the document itself was answered
        logger.debug("%s does not tell which flight it is of", ledger, exc_info=True)
        return ""
    return _told_flight(ledger, found.st_dev, found.st_ino)


@lru_cache(maxsize=8)
def _told_flight(ledger: Path, _device: int, _file: int) -> str:
    """Of this file, which is asked for each second and not opened each time."""
    told = flight_at(ledger)
    return hashlib.blake2b(repr(told).encode(), digest_size=8).hexdigest() if told else ""


def small_document(path: Path) -> tuple[bytes, str] | None:
    """Content and entity tag of a document, None for a large one. A file that is sent while the connection is reset would stay
    open until it is collected. Raises OSError."""
    with inside.reading(path, path.parent) as file:
        found = os.fstat(file.fileno())
        if found.st_size > SMALL_BYTES:
            return None
        return file.read(), f"{found.st_mtime_ns:x}-{found.st_size:x}"


@OPERATIONS.add("GET", f"/{STATUS}", Reply("The flight.", StatusDocument, tagged=True, ranged=True), failures=NOT_YET)
async def status(request: web.Request) -> web.StreamResponse:
    """status.json; other machines are not told where things lie on this one."""
    if is_local(request):
        return await document(request)
    try:
        data = await asyncio.to_thread(inside.read, request.app[ROOT] / STATUS, request.app[ROOT], LARGEST_DOCUMENT)
    except OSError:
        raise web.HTTPNotFound(text=f"{STATUS} is not written yet.\n") from None
    text = data.decode("utf-8", "replace")
    with suppress(ValueError, RecursionError):  # escapes would hide where a path ends
        text = json.dumps(json.loads(text), ensure_ascii=False)
    return web.Response(text=without_paths(text), content_type="application/json")


@OPERATIONS.add(
    "GET",
    f"/{JOURNAL_NAME}",
    Reply(
        "A head, and a line for each revision.", JsonLines(("application/x-ndjson",), (JournalHead, PlacementsDocument))
    ),
    query=JournalQuery,
    failures={404: "There is none now: placements.json tells everything."},
)
async def journal(request: web.Request) -> web.StreamResponse:
    """The placements journal: the lines of revisions after `?after=`."""
    path, after = request.app[ROOT] / JOURNAL_NAME, asked_query(request, JournalQuery).after
    try:
        lines = await asyncio.to_thread(told_after, path, after)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):  # there is none, or it is damaged
        raise web.HTTPNotFound(text="placements.json tells everything.\n") from None
    return web.Response(body=lines, content_type="application/x-ndjson")
