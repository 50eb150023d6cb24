"""Receives a stream on its own thread, so that a slow stitcher never delays it, and reconnects when it is lost."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from dataclasses import dataclass
from typing import Literal

import av
import av.logging

from gcs_mosaic.frames.rtsp.address import StreamAddress
from gcs_mosaic.frames.rtsp.connection import Connection, NotConnected
from gcs_mosaic.frames.rtsp.frozen import SamePicture
from gcs_mosaic.frames.rtsp.ring_buffer import Ring, StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.messages import Notice

logger = logging.getLogger(__name__)

MOST_SIZES, MOST_GAPS = 4, 20  # changes of size, and gaps, that are told: damaged streams bring many
_STOP_S = 0.5  # for the thread to end; one that waits for a silent camera is abandoned


@dataclass(slots=True)
class Tally:
    """Reception counters. `since` and `last_arrival` are on the monotonic clock."""

    state: Literal["connecting", "connected", "lost"] = "connecting"
    since: float = 0.0
    last_arrival: float | None = None
    longest_pause_s: float = 0.0  # between two images; a longer one is silence
    seen: int = 0
    damaged: int = 0
    gaps: int = 0
    same_since: float | None = None  # since when it shows the same picture; None: it does not


class Receiver:
    """Puts every decoded image into `ring` until `stop` is set. `notices` are for the operator."""

    def __init__(self, ring: Ring, settings: StreamSettings, stop: threading.Event) -> None:
        self.ring, self.tally = ring, Tally(since=time.monotonic())
        self.notices: queue.SimpleQueue[Notice] = queue.SimpleQueue()
        self._settings, self._stop = settings, stop
        self._address: StreamAddress | None = None
        self._addressed = threading.Event()
        self._same = SamePicture()
        self._said = ""  # last reported reason for having no connection
        self._size: tuple[int, int] | None = None
        self._sizes_said = self._gaps_said = 0
        self._seen_before = -1  # pictures when it was connected last
        self._untold: str | None = (
            None  # that it is connected: one that brings pictures as little as the one before is not told
        )
        self._thread = threading.Thread(target=self._run, name="stream", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def join(self) -> None:
        """Wait briefly for the thread to end after `stop`."""
        self._thread.join(_STOP_S)

    def use(self, address: StreamAddress) -> None:
        """Change the stream's address; a working connection is kept."""
        self._address = address
        self._addressed.set()

    def _run(self) -> None:
        wait_s = self._settings.reconnect_first_s
        while not self._stop.is_set():
            if self._address is None:
                self._addressed.wait(self._settings.reconnect_longest_s)
                continue
            seen = self.tally.seen
            self._lost(self._address, self._received(self._address))
            if self.tally.seen > seen:
                wait_s = self._settings.reconnect_first_s
            self._stop.wait(wait_s)
            wait_s = min(2 * wait_s, self._settings.reconnect_longest_s)

    def _received(self, address: StreamAddress) -> str:
        """Run one connection to its end; returns why it ended, whatever was raised: a thread's death would go unnoticed."""
        try:
            return self._receive(address)
        except Exception as error:
            reason = f"a fault of the kind {type(error).__name__}"  # the message itself may contain the address
            if reason != self._said:  # otherwise repeated at each attempt
                fault = RuntimeError(reason).with_traceback(error.__traceback__)
                logger.error("%s cannot be received", address.shown, exc_info=fault)
            return reason

    def _receive(self, address: StreamAddress) -> str:
        """Run one connection to its end; returns why it ended."""
        # FFmpeg's log may contain the address with its password: it is captured here and never shown.
        with av.logging.Capture() as log:
            connection = Connection.open(address, self._settings, log)
            if isinstance(connection, NotConnected):
                return connection.reason
            with contextlib.closing(connection):
                self._connected(address, connection)
                return self._read(connection)

    def _read(self, connection: Connection) -> str:
        while not self._stop.is_set():
            pictures = connection.read()
            if isinstance(pictures, NotConnected):
                return pictures.reason
            now = time.monotonic()
            self._note_gap(connection, now)
            for picture in pictures:
                self._note_picture(connection.address)
                self.tally.seen += 1
                self.tally.damaged += picture.damaged
                self._note_size(connection.address, (picture.video.width, picture.video.height))
                self.ring.put(picture, now)
                self._note_same(picture, now)
        return "ended"

    # Reporting

    def _connected(self, address: StreamAddress, connection: Connection) -> None:
        now, tally = time.monotonic(), self.tally
        after = f" again after {now - tally.since:.1f} s" if tally.state == "lost" else ""
        text = f"is connected{after}: {connection.described}"
        tally.state, tally.since, tally.last_arrival, self._said = "connected", now, now, ""
        tally.longest_pause_s = connection.longest_pause_s
        brought_nothing, self._seen_before = tally.seen == self._seen_before, tally.seen
        self._untold = text if brought_nothing else None
        if not brought_nothing:
            self._say(address, "info", text)

    def _note_picture(self, address: StreamAddress) -> None:
        if self._untold is not None:
            self._say(address, "info", self._untold)
            self._untold = None

    def _lost(self, address: StreamAddress, reason: str) -> None:
        if self._stop.is_set():
            return
        if self.tally.state == "connected":
            self.tally.state, self.tally.since = "lost", time.monotonic()
            self.tally.gaps += self._untold is None
            if self._untold is None:
                self._say(address, "error", f"is lost ({reason}); trying again until it is back")
        elif reason != self._said:
            self._say(address, "warning", f"cannot be received ({reason}); trying again until it can")
        self._said = reason

    def _note_gap(self, connection: Connection, now: float) -> None:
        if connection.paused_s is not None:
            self.tally.gaps += 1
            self._gaps_said += 1
            if self._gaps_said <= MOST_GAPS:
                last = "; further gaps are counted and not told" if self._gaps_said == MOST_GAPS else ""
                text = f"brought nothing for {connection.paused_s:.1f} s; frames of that time are missing{last}"
                self._say(connection.address, "warning", text)
        self.tally.last_arrival, self.tally.longest_pause_s = now, connection.longest_pause_s

    def _note_same(self, picture: StreamPicture, now: float) -> None:
        if not picture.damaged:
            self._same.note(picture.video.luma(), now)
            self.tally.same_since = self._same.since

    def _note_size(self, address: StreamAddress, size: tuple[int, int]) -> None:
        if self._size not in (None, size) and self._sizes_said < MOST_SIZES:
            self._sizes_said += 1
            last = "; further changes are not told" if self._sizes_said == MOST_SIZES else ""
            self._say(address, "warning", f"has changed its pictures to {size[0]} x {size[1]} pixels{last}")
        self._size = size

    def _say(self, address: StreamAddress, level: Literal["info", "warning", "error"], text: str) -> None:
        self.notices.put(Notice(source="stream", level=level, text=f"{address.shown} {text}"))
