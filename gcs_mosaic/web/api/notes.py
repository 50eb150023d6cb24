"""What the handlers of finds, scale, reviews and hints share: the notes, the thread that owns them, places that are sent."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.anchors.anchoring import Anchoring, IslandAnchor
from gcs_mosaic.notes.anchors.pins import Pins, SetPin
from gcs_mosaic.notes.anchors.scales import Scales
from gcs_mosaic.notes.finds.finds import Finds
from gcs_mosaic.notes.ground.binding import Binding, GroundFollower
from gcs_mosaic.notes.search.dismissed_hints import DismissedHints
from gcs_mosaic.notes.search.hint_wishes import HintWishes
from gcs_mosaic.notes.search.looking import Looking
from gcs_mosaic.notes.search.opinions import Opinions
from gcs_mosaic.notes.search.reviews import Reviews
from gcs_mosaic.notes.search.seen_ground import IslandGround
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import FURTHEST, Unfit
from gcs_mosaic.store.disk import CannotWrite, DiskFull
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.store.folder import NOTES_NAME
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.common import OneThread, beside, in_thread, steadily
from gcs_mosaic.web.feed import Feed

logger = logging.getLogger(__name__)

KEEP_S = 2.0  # between two looks whether the file is still there
MOST_WAITING = 64  # requests for a disk that answers slowly
TOO_SLOW = "The disk with the notes is too slow now: nothing was changed."
CANNOT = (CannotWrite, OSError, UsageError, sqlite3.Error)

Result = TypeVar("Result")
NO_PLACE = "island, x and y are to be given, or frame and pixel."
IslandNumber = Annotated[int, Limits(least=0, most=999_999)]
Canvas = Annotated[float, Limits(least=-FURTHEST, most=FURTHEST)]
CanvasPoint = Annotated[tuple[Canvas, Canvas], "x, y on the island's canvas"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedBody:
    """A place of the map, or the pixel of an original."""

    island: IslandNumber | None = None
    x: Annotated[Canvas | None, "on the island's canvas"] = None
    y: Canvas | None = None
    frame: Annotated[
        int | None, Limits(least=0, most=1 << 53), "number of a painted frame, instead of island, x and y"
    ] = None
    pixel: Annotated[tuple[Canvas, Canvas] | None, "of the frame's original"] = None


class Notes:
    """The notes of the flight that is served; all but `run`, `islands`, `ground` and the follower for the thread of `run`."""

    def __init__(self, view: FlightView, feed: Feed) -> None:
        self.follower = GroundFollower(view)
        self.book = NotesBook(view.root)
        self.finds, self.scales = Finds(self.book), Scales(self.book)
        self.reviews, self.dismissed = Reviews(self.book), DismissedHints(self.book)
        self.looking, self.opinions = Looking(self.book, self.reviews), Opinions(self.book)
        self.ground = IslandGround()
        self.hint_wishes = HintWishes(self.book)
        self.pins, self._anchoring = Pins(self.book), Anchoring(view, self.follower)
        self._feed = feed
        self._thread = OneThread("notes", MOST_WAITING, TOO_SLOW, finishes=True)

    async def run(self, work: Callable[..., Result], *given: Any) -> Result:
        """Work on the notes' own thread; pages are told if something has changed. Raises HTTPServiceUnavailable."""
        try:
            return await self._thread.run(self._done, work, *given)
        except CANNOT as error:
            logger.warning("the notes cannot be kept", exc_info=True)
            raise web.HTTPServiceUnavailable(text=f"{sentence_of(error, self.book.path)}\n") from error

    def pinned(self) -> tuple[int, list[SetPin], bool]:
        """Revision, the pins, and whether positions may lay the map."""
        return self.book.revision, self.pins.all(), self.pins.by_positions

    def islands(self, pins: Sequence[SetPin], by_positions: bool) -> Mapping[int, IslandAnchor]:
        """How islands lie on earth, of what `pinned` tells; for any thread."""
        return self._anchoring.islands(pins, by_positions=by_positions)

    def keep(self) -> None:
        """What has to be done now and then."""
        try:
            self.reviews.flush_if_due()
            self.book.keep()
            self._tell()
        except CANNOT:
            logger.info("the notes are kept in memory", exc_info=True)

    def open(self) -> None:
        """Read what an earlier process has left."""
        try:
            self._tell()
        except CANNOT:
            logger.warning("the notes cannot be read", exc_info=True)

    def flush(self) -> None:
        """Write what is held in memory."""
        try:
            self.reviews.flush()
        except CANNOT:
            logger.warning("the last reviews cannot be written", exc_info=True)

    def close(self) -> None:
        self.flush()
        self.book.close()

    async def keep_for_ever(self) -> None:
        await self._thread.run_anyway(self.open)
        await steadily(self._kept, KEEP_S)

    async def _kept(self) -> bool:
        await self._thread.run_anyway(self.keep)
        return False

    async def flush_soon(self) -> None:
        await self._thread.run_anyway(self.flush)

    async def end(self) -> None:
        await self._thread.run_anyway(self.close)
        self._thread.end()

    def _done(self, work: Callable[..., Result], *given: Any) -> Result:
        result = work(*given)
        self._tell()
        return result

    def _tell(self) -> None:
        revision = self.book.revision
        if revision != self._feed.notes:
            self._feed.tell_notes(revision)


NOTES = web.AppKey("notes", Notes)


def add_notes(app: web.Application, view: FlightView, feed: Feed) -> None:
    """Keep the notes of a flight as long as the application runs."""
    app[NOTES] = Notes(view, feed)
    app.on_shutdown.append(_flushed)
    app.cleanup_ctx.append(beside(lambda app: app[NOTES].keep_for_ever(), _ended))


async def _flushed(app: web.Application) -> None:
    """At once: what is waited for at the end, requests and processes, may take longer than this process is given."""
    await app[NOTES].flush_soon()


async def _ended(app: web.Application) -> None:
    await app[NOTES].end()


def id_of(request: web.Request) -> int:
    return int(request.match_info["id"])


async def bound(request: web.Request, asked: PlacedBody) -> Binding | None:
    """Where something is set; None if that was not sent. Raises Unfit."""
    follower = request.app[NOTES].follower
    if asked.frame is not None:
        if asked.pixel is None:
            raise Unfit("pixel is to be two numbers.")
        found = await in_thread(request, follower.bound_to_pixel, asked.frame, *asked.pixel)
        if found is None:
            raise Unfit("That frame is not on the map, or has no such pixel.")
        return found
    if asked.island is None:
        return None
    if asked.x is None or asked.y is None:
        raise Unfit("x and y are to be numbers.")
    return await in_thread(request, follower.bound, asked.island, asked.x, asked.y)


def sentence_of(error: BaseException, path: Path) -> str:
    """Why the notes cannot be written, without where things lie on this machine."""
    if isinstance(error, DiskFull):
        return "The disk is full: nothing was changed. Free some space, then try again."
    if isinstance(error, CannotWrite | UsageError):
        why = str(error).replace(str(path), NOTES_NAME).replace(str(path.parent), "the flight's folder")
        return f"The notes cannot be kept now, and nothing was changed: {why}."
    return f"The notes cannot be kept now, and nothing was changed ({getattr(error, 'strerror', None) or 'an error'})."
