"""The process that receives a live stream: what FFmpeg does with a camera's bytes can end it, but not the flight.

It is told of requests on a pipe, and sends on it what `source.Stream` gives, and the bytes of a frame's file with its message.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from contextlib import suppress
from dataclasses import asdict
from multiprocessing.connection import Connection

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.source import Item, stream_here
from gcs_mosaic.messages import Frame, Notice, SourceReport, TriggerEvent
from gcs_mosaic.processes.limits import limit_memory
from gcs_mosaic.processes.pipe import ChildTeller, TellingHandler

MOST_ASKED = 4096  # requests whose events are remembered
MOST_BYTES = (
    1 << 30
)  # of address space, beside three times the pictures that are kept: one of 100 megapixels, and libraries


def receive(pipe: Connection, address: str, settings: StreamSettings) -> None:
    """Main function of the process."""
    limit_memory(MOST_BYTES + 3 * settings.ring_mb * 10**6)
    teller = ChildTeller(pipe)
    logging.basicConfig(level=logging.INFO, handlers=[TellingHandler(teller)])
    stop, requests, asked = threading.Event(), Requests(), _Asked()
    threading.Thread(target=_hear, args=(pipe, requests, asked, stop), name="requests", daemon=True).start()
    with suppress(OSError):  # the program has ended
        try:
            items = stream_here(address, stop, requests, settings)
        except UsageError as error:
            teller.send({"refused": str(error)})
            return
        for item in items:
            _send(item, teller, asked)


def _hear(pipe: Connection, requests: Requests, asked: _Asked, stop: threading.Event) -> None:
    """Pass on requests until the program closes the pipe. The program itself is trusted, so these are pickled."""
    with suppress(EOFError, OSError):
        while True:
            match pipe.recv():
                case (int(number), Ask() as ask):
                    asked.note(number, ask.event)
                    requests.put(ask)
                case Offer() as offer:
                    requests.put(offer)
    stop.set()


class _Asked:
    """By which number the program knows an event that has asked for a frame."""

    def __init__(self) -> None:
        self._numbers: OrderedDict[TriggerEvent, int] = OrderedDict()
        self._lock = threading.Lock()

    def note(self, number: int, event: TriggerEvent | None) -> None:
        if event is not None:
            with self._lock:
                self._numbers[event] = number
                if len(self._numbers) > MOST_ASKED:
                    self._numbers.popitem(last=False)

    def number(self, event: TriggerEvent | None) -> int | None:
        with self._lock:
            return None if event is None else self._numbers.get(event)


def _send(item: Item, teller: ChildTeller, asked: _Asked) -> None:
    match item:
        case Frame(data=bytes(data)):
            told = {"name": item.name, "received": item.received, "modified": item.modified}
            teller.send({"frame": told, "asked": asked.number(item.taken_for)}, data)
        case Notice():
            teller.send({"notice": [item.level, item.text]})
        case SourceReport():
            teller.send({"report": asdict(item)})
