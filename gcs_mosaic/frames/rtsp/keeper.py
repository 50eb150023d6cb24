"""A live stream as the program sees it: received by a process of its own, which is started again when it ends."""

from __future__ import annotations

import importlib.util
import logging
import re
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from gcs_mosaic.errors import UsageError
from gcs_mosaic.even_clock import even_utc, made_even
from gcs_mosaic.frames.rtsp.address import AUTO, check_allowed, parse_stream
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.source import Item, stream_name
from gcs_mosaic.frames.rtsp.stream_process import MOST_ASKED, receive
from gcs_mosaic.messages import Frame, Notice, SourceReport, SourceState, TriggerEvent, content_hash
from gcs_mosaic.processes.child import ChildProcess, ending
from gcs_mosaic.processes.keeper import Silence, one_after_another
from gcs_mosaic.processes.pipe import Message, messages, was_logged

logger = logging.getLogger(__name__)

LOOK_S = 0.02  # longest delay of a request
WHAT = "the process that receives the stream"
NAME = re.compile(r"stream/\d{8}-\d{6}\.\d{3}(#\d{1,6})?\.jpg")
COUNTS = ("seen", "taken", "damaged", "gaps")
LEVELS = ("info", "warning", "error")


def stream(
    address: str, stop: threading.Event, requests: Requests, settings: StreamSettings | None = None
) -> Iterator[Item]:
    """Frames of the stream at `address` (or `auto`), on request or as configured, until `stop` is set.

    Every trigger gets the sharpest undamaged image near its time; a frame carries its JPEG data. Raises UsageError
    immediately for an invalid address, and if PyAV is missing.
    """
    settings = settings or StreamSettings()
    if address == AUTO:
        check_allowed(settings.allowed_hosts)
    else:
        parse_stream(address)
    if importlib.util.find_spec("av") is None:
        raise UsageError("--rtsp needs PyAV, which is not installed: pip install 'gcs-mosaic[rtsp]' brings it.")
    return _Keeper(address, requests, settings).items(stop)


class _Keeper:
    def __init__(self, address: str, requests: Requests, settings: StreamSettings) -> None:
        self._address, self._requests, self._settings = address, requests, settings
        self._asked: OrderedDict[int, TriggerEvent] = OrderedDict()  # by the numbers that the process knows them by
        self._number = 0
        self._offer: Offer | None = None  # the newest that was passed on
        self._report: SourceReport | None = None
        self._counted = dict.fromkeys(COUNTS, 0)  # by the processes before this one

    def items(self, stop: threading.Event) -> Iterator[Item]:
        """All items, until `stop` is set."""
        for process in one_after_another(self._started, WHAT, stop):
            yield from self._served(process, stop)
            ended = process.end()
            if not stop.is_set():
                yield from self._gone(ending(ended))

    def _started(self) -> ChildProcess:
        return ChildProcess(WHAT, receive, self._address, self._settings)

    def _served(self, process: ChildProcess, stop: threading.Event) -> Iterator[Item]:
        """Items of one process until it has ended or hangs, or `stop` is set."""
        silence = Silence()  # a report comes each second
        try:
            if self._offer is not None:
                process.pipe.send(self._offer)
            while not stop.is_set():
                self._pass_on(process)
                for message, mass in messages(process.pipe, LOOK_S):
                    silence.heard()
                    yield from self._items_of(message, mass)
                if silence.is_too_long():
                    logger.warning("%s hangs", WHAT)
                    return
        except (EOFError, OSError):
            logger.info("%s has ended", WHAT, exc_info=True)

    def _pass_on(self, process: ChildProcess) -> None:
        """Raises OSError when it has ended."""
        for request in self._requests.drain():
            if isinstance(request, Ask):
                self._number += 1
                if request.event is not None:
                    self._asked[self._number] = request.event
                    if len(self._asked) > MOST_ASKED:
                        self._asked.popitem(last=False)
                process.pipe.send((self._number, request))
            else:
                self._offer = request
                process.pipe.send(request)

    def _items_of(self, message: Message, mass: bytes) -> Iterator[Item]:
        """What a message of the process tells. Raises OSError for one that is none of it."""
        try:
            if was_logged(message, WHAT):
                return
            if "frame" in message:
                yield self._frame(message, mass)
            elif "notice" in message:
                level, text = message["notice"]
                yield Notice(source="stream", level=level if level in LEVELS else "warning", text=str(text))
            elif "report" in message:
                yield self._reported(message["report"])
            else:
                logger.warning("%s cannot work: %s", WHAT, message.get("refused"))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise OSError("no message of ours") from error

    def _frame(self, message: Message, data: bytes) -> Frame:
        told = message["frame"]
        if not NAME.fullmatch(told["name"]):
            raise ValueError("no name of a frame")
        return Frame(
            name=told["name"],
            path=Path(told["name"]),
            data=data,
            content_hash=content_hash(data),
            size=len(data),
            received=float(told["received"]),
            modified=float(told["modified"]),
            taken_for=self._asked.pop(message["asked"], None) if message["asked"] is not None else None,
        )

    def _reported(self, told: dict[str, Any]) -> SourceReport:
        if told["state"] not in get_args(SourceState):
            raise ValueError("no state")
        counted: dict[str, Any] = {name: int(told[name]) + before for name, before in self._counted.items()}
        times = {name: made_even(told[name]) for name in ("since_utc", "last_seen_utc", "same_since_utc")}
        fields: dict[str, Any] = times | counted
        self._report = SourceReport(kind="stream", name=str(told["name"]), state=told["state"], **fields)
        return self._report

    def _gone(self, ended: str) -> Iterator[Item]:
        last = self._report or SourceReport(kind="stream", name=stream_name(self._address), state="lost")
        self._report = replace(last, state="lost", since_utc=even_utc(), gaps=last.gaps + 1, same_since_utc=None)
        self._counted = {name: getattr(self._report, name) for name in COUNTS}
        yield Notice(source="stream", level="warning", text=f"{WHAT} has ended ({ended}); it is started again")
        yield self._report
