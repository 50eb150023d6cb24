"""Publishes tile updates from another thread to every open page."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import contextmanager, suppress

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web.change import Change, NotesChange

News = Change | NotesChange


class Feed:
    """Publishes every change to every subscriber; changes for a slow one are merged, so memory is bounded."""

    def __init__(self) -> None:
        self.revision = 0
        self.notes = 0  # revision of what people have added
        self._lock = threading.Lock()
        self._subscriptions: set[Subscription] = set()
        self._closed = False
        self._before: list[Callable[[Change], None]] = []

    def before_telling(self, hear: Callable[[Change], None]) -> None:
        """Have this called with each change before any page is told of it; on the thread that tells."""
        self._before.append(hear)

    def publish(self, revision: int, tiles: Iterable[tuple[int, Tile]] | None) -> None:
        """Publish a revision that is on disk, with the tiles that painting one frame changed (None: any).

        Thread-safe. Call once per painted frame: refreshed ancestors among the tiles are recognised as such, which is only
        correct while the tiles of one call were painted at one level.
        """
        self.pass_on(Change.of_frame(revision, tiles))

    def pass_on(self, change: Change) -> None:
        """Publish a change, perhaps of several frames. Thread-safe."""
        for hear in self._before:
            hear(change)
        with self._lock:
            self.revision = change.revision
            for subscription in self._subscriptions:
                subscription.offer(change)

    def tell_notes(self, revision: int) -> None:
        """Publish a revision of what people have added to the flight. Thread-safe."""
        with self._lock:
            self.notes = revision
            for subscription in self._subscriptions:
                subscription.offer_notes(NotesChange(revision))

    @contextmanager
    def subscribe(self) -> Iterator[Subscription]:
        """Changes from now on, for a task of the running event loop."""
        subscription = Subscription(asyncio.get_running_loop())
        with self._lock:
            self._subscriptions.add(subscription)
            subscription.closed = self._closed
        try:
            yield subscription
        finally:
            with self._lock:
                self._subscriptions.discard(subscription)

    @property
    def subscribers(self) -> int:
        return len(self._subscriptions)

    def close(self) -> None:
        """End every subscription, also those to come."""
        with self._lock:
            self._closed = True
            for subscription in self._subscriptions:
                subscription.close()


class Subscription:
    """One page's subscription: holds at most one pending change of each kind."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.closed = False
        self._loop = loop
        self._lock = threading.Lock()
        self._pending: Change | None = None
        self._pending_notes: NotesChange | None = None
        self._news = asyncio.Event()

    def offer(self, change: Change) -> None:
        with self._lock:
            self._pending = change.after(self._pending)
        self._wake()

    def offer_notes(self, change: NotesChange) -> None:
        with self._lock:
            self._pending_notes = change
        self._wake()

    def close(self) -> None:
        self.closed = True
        self._wake()

    async def changes(self, timeout_s: float) -> AsyncIterator[News | None]:
        """Yields each change, and None after every `timeout_s` without one, until closed."""
        while not self.closed:
            change = await self.next(timeout_s)
            if not self.closed:
                yield change

    async def next(self, timeout_s: float) -> News | None:
        """The next change; None after `timeout_s` without one, or when closed."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self._news.wait()
        self._news.clear()
        with self._lock:
            if self._pending is not None and self._pending_notes is not None:
                self._news.set()  # one after the other
            if self._pending is not None:
                change, self._pending = self._pending, None
                return change
            notes, self._pending_notes = self._pending_notes, None
            return notes

    def _wake(self) -> None:
        with suppress(RuntimeError):  # the page's event loop may have ended already
            self._loop.call_soon_threadsafe(self._news.set)
