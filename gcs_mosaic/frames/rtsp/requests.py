"""Requests from other threads to a stream: frames at a given time, and a new address."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.frames.rtsp.frame_selection import Ask

_ROOM = 1000  # limits memory if the stream hangs


@dataclass(frozen=True, slots=True)
class Offer:
    """A stream address announced by the aircraft."""

    url: str


class Requests:
    """Queue from any thread to the stream's thread."""

    def __init__(self) -> None:
        self._queue: queue.Queue[Ask | Offer] = queue.Queue(_ROOM)

    def put(self, request: Ask | Offer) -> bool:
        """Returns False if the queue is full; never blocks."""
        try:
            self._queue.put_nowait(request)
        except queue.Full:
            return False
        return True

    def drain(self) -> Iterator[Ask | Offer]:
        """Requests since the last call; those that come meanwhile are left for the next one."""
        for _ in range(self._queue.qsize()):
            try:
                yield self._queue.get_nowait()
            except queue.Empty:
                return
