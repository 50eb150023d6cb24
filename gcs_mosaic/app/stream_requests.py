"""Camera events become requests to a live stream, on the link's own thread: a busy stitcher must not make them late."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import TypeVar

from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.messages import CaptureResult, StreamOffer, TriggerEvent
from gcs_mosaic.triggers.clocks import SourceClocks
from gcs_mosaic.triggers.shots import New, ShotMerger, ShotSettings

T = TypeVar("T")


class StreamRequests:
    """Asks for one frame for each shot, however many messages tell of it. Links on several threads may share it."""

    def __init__(self, requests: Requests, shots: ShotSettings) -> None:
        self._requests = requests
        self._merger, self._clocks = ShotMerger(shots), SourceClocks()
        self._lock = threading.Lock()
        self._heard = 0

    def follow(self, items: Iterator[T]) -> Iterator[T]:
        """What a link brings, passed on; what it means for the stream is told when whoever asked has dealt with it."""
        for item in items:
            yield item
            if isinstance(item, TriggerEvent):
                self._hear(item)
            elif isinstance(item, StreamOffer):
                self._requests.put(Offer(item.url))

    def _hear(self, event: TriggerEvent) -> None:
        with self._lock:
            self._heard += 1
            moment = self._clocks.moment(event)
            verdict = self._merger.add(self._heard, event)
        if isinstance(verdict, New) and event.result is not CaptureResult.FAILED:
            self._requests.put(Ask(moment, event))
