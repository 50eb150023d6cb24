"""Frames from a live stream, requested by triggers, at intervals or by motion of the view."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import cv2

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.frames.rtsp.address import AUTO, StreamAddress, is_allowed, parse_stream
from gcs_mosaic.frames.rtsp.frame_selection import Ask, Pick, Picker, Unanswered
from gcs_mosaic.frames.rtsp.interval import Wishes
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.ring_buffer import Ring
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.messages import Frame, Notice, SourceReport, content_hash

if TYPE_CHECKING:
    from gcs_mosaic.frames.rtsp.receiver import Receiver

Item: TypeAlias = Frame | Notice | SourceReport

_LOOK_S = 0.05  # longest wait for an image between checks for triggers
_REPORT_S = 1.0
_MB = 1_000_000
MOST_SAID = 8  # addresses that were offered in vain, and triggers that got no frame
OFFER_EACH_S = 10.0  # another stream is taken at most so often: each costs a connection


def stream_here(address: str, stop: threading.Event, requests: Requests, settings: StreamSettings) -> Iterator[Item]:
    """Frames of the stream at `address` (or `auto`), received by this process; see `keeper.stream`. Raises UsageError."""
    from gcs_mosaic.frames.rtsp.receiver import Receiver  # loads PyAV, which is an extra

    given = None if address == AUTO else parse_stream(address)
    receiver = Receiver(Ring(settings.ring_s, settings.ring_mb * _MB), settings, stop)
    return Stream(given, receiver, requests, settings).items(stop)


def stream_name(address: str) -> str:
    """The source's display name; never contains a password."""
    return AUTO if address == AUTO else parse_stream(address).shown


class Stream:
    """A stream that is listened to: what is asked of it, what it gives, what is said of it."""

    def __init__(
        self, address: StreamAddress | None, receiver: Receiver, requests: Requests, settings: StreamSettings
    ) -> None:
        self._address, self._receiver, self._requests, self._settings = address, receiver, requests, settings
        self._ring = receiver.ring
        self._picker = Picker(settings)
        self._wishes = Wishes(settings.every, settings.moved)
        self._names: Counter[str] = Counter()
        self._taken = self._unanswered = self._unanswered_said = 0
        self._said_cut_short = False
        self._is_given = address is not None
        self._said: set[str] = set()
        self._next_offer = 0.0  # monotonic seconds
        self._reported: tuple[SourceReport, float] | None = None

    def items(self, stop: threading.Event) -> Iterator[Item]:
        """All items, until `stop` is set."""
        yield from self._begin()
        self._receiver.start()
        while not stop.is_set():
            self._ring.wait(_LOOK_S)
            yield from self._take_requests()
            yield from self._drain_notices()
            yield from self._take_frames()
            yield from self._report(time.monotonic())
        self._receiver.join()

    def _begin(self) -> Iterator[Notice]:
        if self._address:
            self._receiver.use(self._address)
        where = self._address.shown if self._address else "the stream that the aircraft will tell of"
        when = f"and {self._wishes.described} " if self._wishes.described else ""
        yield _notice("info", f"frames come from {where}, one for each trigger {when}(every: 1 s needs no triggers)")

    def _take_requests(self) -> Iterator[Notice]:
        now = time.monotonic()
        for request in self._requests.drain():
            if isinstance(request, Ask):
                self._picker.ask(request, now)
            else:
                yield from self.hear(request)
        pictures = self._ring.pictures()
        if pictures and not pictures[-1].damaged and pictures[-1].clock.is_settled(now):
            moment = self._wishes.moment(pictures[-1])
            if moment is not None:
                self._picker.ask(Ask(moment), now)

    def hear(self, offer: Offer) -> Iterator[Notice]:
        """The aircraft announces a stream address: accepted if none was given, and only if it is on the allow-list."""
        if self._is_given:
            return
        try:
            address = parse_stream(offer.url)
        except UsageError:
            yield from self._say_once("the aircraft tells of a stream whose address is not understood")
            return
        if address == self._address:
            return
        if not is_allowed(address.host, self._settings.allowed_hosts):
            text = f"{address.shown}, of which the aircraft tells, is not in stream: allowed_hosts"
            yield from self._say_once(text)
            return
        if time.monotonic() < self._next_offer:
            return
        self._next_offer = time.monotonic() + OFFER_EACH_S
        self._address = address
        self._receiver.use(address)
        yield _notice("info", f"the aircraft's stream is {address.shown}")

    def _say_once(self, text: str) -> Iterator[Notice]:
        """What somebody on the link can have said as often as they like."""
        if text not in self._said and len(self._said) < MOST_SAID:
            self._said.add(text)
            yield _notice("warning", text)

    def _drain_notices(self) -> Iterator[Notice]:
        while not self._receiver.notices.empty():
            yield self._receiver.notices.get()
        if self._ring.cut_short and not self._said_cut_short:
            self._said_cut_short = True
            text = f"pictures are kept for less than {self._settings.ring_s:g} s: {self._settings.ring_mb} MB are full"
            yield _notice("warning", text)

    def _take_frames(self) -> Iterator[Frame | Notice]:
        for decided in self._picker.due(self._ring.pictures(), time.monotonic()):
            if isinstance(decided, Unanswered):
                if decided.ask.event:
                    yield from self._note_unanswered(decided)
                continue
            if self._unanswered > 1:
                yield _notice("info", f"triggers get frames again, {self._unanswered} got none")
            self._unanswered = 0
            self._taken += 1
            yield self._frame(decided)

    def _note_unanswered(self, unanswered: Unanswered) -> Iterator[Notice]:
        """Report only the first of consecutive ones, and no more of a stream that leaves out every other one for ever; all are
        counted."""
        self._unanswered += 1
        if self._unanswered == 1 and self._unanswered_said < MOST_SAID:
            self._unanswered_said += 1
            last = "; further ones are counted and not told" if self._unanswered_said == MOST_SAID else ""
            yield _notice("warning", f"a trigger gets no frame: {unanswered.reason}{last}")

    def _frame(self, pick: Pick) -> Frame:
        """Encode once; the stitched bytes are the ones kept."""
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._settings.jpeg_quality]
        data = cv2.imencode(".jpg", pick.picture.colour(), quality)[1].tobytes()
        utc = time.time() - time.monotonic() + pick.moment
        name = f"stream/{datetime.fromtimestamp(utc, UTC):%Y%m%d-%H%M%S.%f}"[:-3]
        self._names[name] += 1
        return Frame(
            name=f"{versioned(name, self._names[name])}.jpg",
            path=Path(f"{name}.jpg"),
            data=data,
            content_hash=content_hash(data),
            size=len(data),
            received=time.monotonic(),
            modified=utc,
            taken_for=pick.ask.event,
        )

    def _report(self, now: float) -> Iterator[SourceReport]:
        tally = self._receiver.tally
        last = tally.last_arrival
        quiet = tally.state == "connected" and last is not None and now - last > tally.longest_pause_s
        utc_of_zero = time.time() - now
        report = SourceReport(
            kind="stream",
            name=self._address.shown if self._address else AUTO,
            state="silent" if quiet else tally.state,
            since_utc=(last if quiet and last is not None else tally.since) + utc_of_zero,
            last_seen_utc=None if last is None else last + utc_of_zero,
            seen=tally.seen,
            taken=self._taken,
            damaged=tally.damaged,
            gaps=tally.gaps,
            same_since_utc=None if tally.same_since is None else tally.same_since + utc_of_zero,
        )
        before = self._reported
        if before is None or before[0].state != report.state or now - before[1] >= _REPORT_S:
            self._reported = (report, now)
            yield report


def _notice(level: Literal["info", "warning"], text: str) -> Notice:
    return Notice(source="stream", level=level, text=text)
