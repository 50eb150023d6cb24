"""What is asked of a stream by the other threads: frames of a moment, and another address."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.frames.rtsp.frame_selection import Ask

_ROOM = 1000  # a stream that hangs must not fill the memory


@dataclass(frozen=True, slots=True)
class Offer:
    """Where the aircraft says that its stream is."""

    url: str


class Requests:
    """From any thread to the stream's."""

    def __init__(self) -> None:
        self._queue: queue.Queue[Ask | Offer] = queue.Queue(_ROOM)

    def put(self, request: Ask | Offer) -> bool:
        """False if there is no room; never waits."""
        try:
            self._queue.put_nowait(request)
        except queue.Full:
            return False
        return True

    def drain(self) -> Iterator[Ask | Offer]:
        """What was asked since the last time."""
        while True:
            try:
                yield self._queue.get_nowait()
            except queue.Empty:
                return
