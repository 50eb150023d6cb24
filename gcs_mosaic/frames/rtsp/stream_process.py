"""The process that receives a live stream: what FFmpeg does with a camera's bytes can end it, but not the flight.

It is told of requests on a pipe, and sends on it what `source.Stream` gives. What comes from it is JSON, and the bytes of a
frame's file after its message: a process under attack can send what is wrong, but nothing that is executed.
"""

from __future__ import annotations

import json
import logging
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from multiprocessing.connection import Connection
from typing import Any

from gcs_mosaic.children import outlive_signals
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.source import Item, stream_here
from gcs_mosaic.messages import Frame, Notice, SourceReport, TriggerEvent
from gcs_mosaic.processes.limits import limit_memory

MOST_ASKED = 4096  # requests whose events are remembered
MOST_BYTES = (
    1 << 30
)  # of address space, beside three times the pictures that are kept: one of 100 megapixels, and libraries

Message = dict[str, Any]


def receive(pipe: Connection, address: str, settings: StreamSettings) -> None:
    """Main function of the process."""
    outlive_signals()
    limit_memory(MOST_BYTES + 3 * settings.ring_mb * 10**6)
    sender = _Sender(pipe)
    logging.basicConfig(level=logging.INFO, handlers=[sender])
    stop, requests, asked = threading.Event(), Requests(), _Asked()
    threading.Thread(target=_hear, args=(pipe, requests, asked, stop), name="requests", daemon=True).start()
    with suppress(OSError):  # the program has ended
        try:
            items = stream_here(address, stop, requests, settings)
        except UsageError as error:
            sender.send({"refused": str(error)})
            return
        for item in items:
            sender.send_item(item, asked)


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


class _Sender(logging.Handler):
    """Sends items and log records. From any thread."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__()
        self._pipe = pipe
        self._one_at_a_time = threading.Lock()

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(OSError):
            self.send({"log": [record.levelno, self.format(record)]})

    def send_item(self, item: Item, asked: _Asked) -> None:
        match item:
            case Frame(data=bytes(data)):
                told = {"name": item.name, "received": item.received, "modified": item.modified}
                self.send({"frame": told, "asked": asked.number(item.taken_for)}, data)
            case Notice():
                self.send({"notice": [item.level, item.text]})
            case SourceReport():
                self.send({"report": asdict(item)})

    def send(self, message: Message, mass: bytes = b"") -> None:
        with self._one_at_a_time:
            self._pipe.send_bytes(json.dumps(message).encode())
            if mass:
                self._pipe.send_bytes(mass)


def messages(pipe: Connection, wait_s: float) -> Iterator[tuple[Message, bytes]]:
    """For the program: what has come within the time, as told. Raises EOFError and OSError when the process has ended, and
    OSError for what is no message of it."""
    while pipe.poll(wait_s):
        try:
            message = json.loads(pipe.recv_bytes())
        except ValueError as error:
            raise OSError("no message of ours") from error
        if not isinstance(message, dict):
            raise OSError("no message of ours")
        yield message, pipe.recv_bytes() if "frame" in message else b""
        wait_s = 0.0
