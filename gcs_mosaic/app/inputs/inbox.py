"""Inputs of a live flight: links and the watched folder, each on its own thread, into one queue."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from gcs_mosaic.app.inputs.links import Item, ItemSource, Report
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.directory import Taken, watch
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.keeper import stream
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.source import stream_name
from gcs_mosaic.frames.video.reading import Known
from gcs_mosaic.frames.video.watched import Room, WatchedVideos
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.mavlink.tlog_writer import Recording
from gcs_mosaic.messages import CaptureResult, DroppedFrame, Frame, LinkReport, Notice, SourceReport, StreamOffer
from gcs_mosaic.store.folder import RECORDING_NAME
from gcs_mosaic.triggers.shots import CameraMessage, New

logger = logging.getLogger(__name__)

ROOM = 10_000  # items; a full inbox blocks the sources, and network input is then buffered by the kernel
PICTURES = 64  # of a live stream, in memory while the disk is full: 0.1 GB of 4K
FILES = 8  # in memory, to save reading them again
PUT_S = 0.2  # longest wait for space between checks of `stop`
STOP_S = 5.0  # for all sources to end


def record(config: Config, recording: Recording, out: Path) -> Notice | None:
    """Start the recording if enabled in the settings; `out` is the flight's folder. Raises UsageError."""
    if not config.record:
        return None
    if config.record is True:
        return recording.open(out / RECORDING_NAME, ours=True)
    return recording.open(Path(config.record), ours=False)


def watching(
    config: Config,
    stop: threading.Event,
    taken: Mapping[str, Taken] | None = None,
    known: Mapping[str, Known] = MappingProxyType({}),
    room: Room | None = None,
) -> ItemSource:
    """The watched folder, created if missing. `taken`, `known`: files and frames of videos already accepted by a resumed flight;
    `room`: for frames of videos. Raises UsageError."""
    failed = replace(initial_report(config), state="ended")
    videos = WatchedVideos(config.frames, config.stream, known, room)
    return ItemSource(watch(Path(config.watch), stop, config.frames, taken, config.decode, videos), failed)


def attach_stream(
    address: str,
    links: Iterable[ItemSource],
    config: Config,
    stop: threading.Event,
    trust: Trust,
    vehicle: int | None = None,
) -> list[ItemSource]:
    """The links, now also requesting frames, plus the live stream that provides them. `vehicle`: whose stream it is, where
    each aircraft has one. Raises UsageError."""
    requests = Requests()
    frames = stream(address, stop, requests, config.stream)
    asking_links = [replace(link, items=asking(link.items, requests, trust, vehicle)) for link in links]
    failed = replace(initial_report(config), state="ended")
    return [*asking_links, ItemSource(frames, failed)]


def keeping(source: ItemSource, keep: Callable[[Frame], Frame]) -> ItemSource:
    """The same source, keeping each frame's original on arrival, on the source's own thread."""
    return replace(source, items=(keep(item) if isinstance(item, Frame) else item for item in source.items))


def initial_report(config: Config) -> SourceReport:
    """State of the frame source before its first report."""
    if config.rtsp:
        return SourceReport(kind="stream", name=stream_name(config.rtsp), state="connecting")
    return SourceReport(kind="folder", name=config.watch, state="watching")


class Inbox:
    """Collects items from the sources until they end, which they do once `stop` is set."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        # Items with the monotonic times at which they came; None only wakes the reader.
        self._items: queue.Queue[tuple[float, Item] | None] = queue.Queue(ROOM)
        self._last_came = 0.0  # of those taken
        self._threads: list[threading.Thread] = []
        self._pictures = threading.BoundedSemaphore(PICTURES)

    def __len__(self) -> int:
        return self._items.qsize()

    def fill(self, sources: Iterable[ItemSource]) -> None:
        """Start a thread for each source."""
        for source in sources:
            name = source.failed.address if isinstance(source.failed, LinkReport) else _thread_name(source.failed)
            self._threads.append(threading.Thread(target=self._pump, args=(source,), name=name, daemon=True))
            self._threads[-1].start()

    def next(self, timeout_s: float) -> Item | None:
        """The oldest item; None after the timeout or a `wake`."""
        with suppress(queue.Empty):
            found = self._items.get(timeout=timeout_s) if timeout_s else self._items.get_nowait()
            while found is None:
                found = self._items.get_nowait()
            self._last_came, item = found
            if isinstance(item, Frame) and item.data is not None:
                self._pictures.release()
            return item
        return None

    def taken_until(self, now: float) -> float:
        """The time up to which everything that came has been taken: `now` if nothing waits."""
        return now if self._items.empty() else min(now, self._last_came)

    def frames(self) -> list[Frame]:
        """The frames that wait, oldest first."""
        with self._items.mutex:
            return [found[1] for found in self._items.queue if found is not None and isinstance(found[1], Frame)]

    def shots(self) -> int:
        """How many shots are announced by the messages that wait."""
        with self._items.mutex:
            return sum(is_shot(found[1]) for found in self._items.queue if found is not None)

    def wake(self) -> None:
        """Make `next` return at once; callable from any thread."""
        with suppress(queue.Full):
            self._items.put_nowait(None)

    def join(self) -> None:
        """Wait for the sources to end, which they do once `stop` is set; one that hangs is abandoned."""
        until = time.monotonic() + STOP_S
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))

    def _pump(self, source: ItemSource) -> None:
        try:
            for item in source.items:
                self._put(item)
        except Exception as error:  # a failing source must be reported
            logger.exception("a source has failed")
            self._put(source.failed)
            self._put(Notice(source="daemon", level="error", text=_last_words(source.failed, error)))

    def _put(self, item: Item) -> None:
        if isinstance(item, Frame) and item.data is not None:
            item = self._within_memory(item)
        came = time.monotonic()
        while True:  # once more after `stop`: a link that ends tells which triggers it still held back
            is_last = self._stop.is_set()  # then nobody takes anything, so that waiting for space is in vain
            with suppress(queue.Full):
                self._items.put((came, item), timeout=0.0 if is_last else PUT_S)
                return
            if is_last:
                return

    def _within_memory(self, frame: Frame) -> Frame | DroppedFrame:
        """Drop the pixels if memory is short: a file is read again in its turn, a stream's image is lost."""
        is_file = frame.path.is_file()
        if not (is_file and len(self) >= FILES) and self._pictures.acquire(blocking=False):
            return frame
        without = replace(frame, data=None)
        if is_file:
            return without
        reason = f"{PICTURES} frames of the stream wait already, the disk or the machine is too slow"
        return DroppedFrame(frame=without, reason=reason)


def is_shot(item: Item | None) -> bool:
    """Whether it is the first message about a shot."""
    return isinstance(item, CameraMessage) and isinstance(item.verdict, New)


def _last_words(failed: Report, error: Exception) -> str:
    what = f"the link {failed.address}" if isinstance(failed, LinkReport) else _watching_of(failed)
    return f"{what} has failed and brings nothing any more, start gcs-mosaic again ({error!r})"


def _thread_name(source: SourceReport) -> str:
    return source.kind if source.vehicle is None else f"{source.kind} {source.vehicle}"


def _watching_of(source: SourceReport) -> str:
    return f"the stream {source.name}" if source.kind == "stream" else f"the watching of {source.name}"


T = TypeVar("T")


def asking(items: Iterator[T], requests: Requests, trust: Trust, vehicle: int | None = None) -> Iterator[T]:
    """Pass on a link's items, requesting one frame per shot after the consumer has handled the item. `vehicle`: only of this
    aircraft's shots; None: of all."""
    for item in items:
        yield item
        match item:
            case CameraMessage(event=event, verdict=New(moment)) if _is_of(event.vehicle, vehicle):
                if event.result is not CaptureResult.FAILED:
                    requests.put(Ask(moment, event, is_trusted=event.teller in trust.sources))
            case StreamOffer() if _is_of(item.vehicle, vehicle):
                requests.put(Offer(item.url))


def _is_of(sender: int, vehicle: int | None) -> bool:
    return vehicle is None or sender == vehicle
