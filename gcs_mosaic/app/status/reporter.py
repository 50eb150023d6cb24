"""Operator output of a running flight: terminal lines, notices in the ledger, status.json."""

from __future__ import annotations

import logging
import sqlite3
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console

from gcs_mosaic.app.status.conditions import Conditions, Facts
from gcs_mosaic.app.status.terminal import Terminal
from gcs_mosaic.app.status.told_times import by_the_clock
from gcs_mosaic.even_clock import even_utc
from gcs_mosaic.messages import Frame, LinkReport, Notice, SourceReport, Topic
from gcs_mosaic.store.disk import CannotWrite, DiskFull, overwrite, write_beside
from gcs_mosaic.store.documents import compact
from gcs_mosaic.store.held_out import Figures, held_out_lines, largest, torn_lines
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.log import log_notice
from gcs_mosaic.store.records import Accounts, FlightRecord, NoticeRecord
from gcs_mosaic.store.status import AircraftStatus, Behind, LastFrame, Status, counted, frames_words, status_document
from gcs_mosaic.store.told_documents import DaemonState

logger = logging.getLogger(__name__)

STATUS_EACH_S = 1.0
NOTICES_SHOWN = 20
NOTICES_KEPT = 1000  # until the ledger takes them
ISLANDS_SHOWN = 12  # all are in mosaic.json
# More than the document needs, more for each of several aircraft: padded, so that a full disk can still overwrite it in place.
STATUS_BYTES, AIRCRAFT_BYTES = 8192, 1024
BRINGING = ("watching", "connected", "connecting")
STYLES = {"info": "", "warning": "yellow", "error": "bold red"}


class Reporter:
    """Reports to the operator and keeps status.json up to date. A full disk never stops it.

    `may_write`: whether the output folder is ours now; nothing is written into another one. `each_frame`: whether the terminal is
    told of each, instead of how the flight is.
    """

    def __init__(
        self,
        out: Path,
        flight: FlightRecord,
        ledger: Ledger,
        console: Console,
        may_write: Callable[[], bool] = lambda: True,
        *,
        each_frame: bool = False,
    ) -> None:
        self._may_write = may_write
        self._unrecorded: deque[tuple[Notice, float]] = deque(maxlen=NOTICES_KEPT)
        self._path = out / "status.json"
        self._flight, self._ledger = flight, ledger
        self._terminal, self._each_frame = Terminal(console, states=not each_frame), each_frame
        self._notices: deque[NoticeRecord] = deque(maxlen=NOTICES_SHOWN)
        self._written, self._begun_utc = 0.0, even_utc()
        self._links: dict[str, LinkReport] = {}
        self.sources: dict[int | None, SourceReport] = {}  # by the aircraft whose it is; None: that of all
        self.conditions = Conditions()
        self.accounts = Accounts()  # as last written
        self.last_frame: LastFrame | None = None

    def say(self, notice: Notice) -> None:
        """Show a notice to the operator and record it."""
        now = time.time()
        log_notice(logger, notice)
        self._notices.append(NoticeRecord(utc=now, source=notice.source, level=notice.level, text=notice.text))
        self.line(notice.text, "bold green" if notice.topic is Topic.PAGE else STYLES[notice.level])
        self._unrecorded.append((notice, now))
        self._record()

    def line(self, text: str, style: str = "") -> None:
        """Print one line with the time of day."""
        self._terminal.line(text, style)

    def frame(self, last: LastFrame, text: str) -> None:
        """A frame has had its turn; `text` says what became of it."""
        self.last_frame = last
        if self._each_frame:
            self.line(text)

    def judge(self, held_out: Figures) -> None:
        """Report the map's held-out error."""
        for line in held_out_lines(largest(held_out, ISLANDS_SHOWN)):
            logger.info("%s", line, extra={"said": True})
            self.line(line)
        for text in torn_lines(held_out):
            self.say(Notice(source="daemon", level="warning", text=text))

    def close(self) -> None:
        """Leave the terminal to others."""
        self._terminal.close()

    def source(self, report: SourceReport) -> None:
        """Update the status of a source of frames."""
        self.sources[report.vehicle] = report

    def link(self, report: LinkReport) -> None:
        """Update a link's status; the time it was last heard is retained."""
        before = self._links.get(report.address)
        heard = report.last_heard_utc or (before.last_heard_utc if before else None)
        self._links[report.address] = replace(report, last_heard_utc=heard)

    def write(
        self,
        state: DaemonState,
        behind: Behind,
        revision: int,
        accounts: Callable[[], Accounts],
        held_out: Callable[[], Figures] = dict,
        *,
        aircraft: Callable[[], tuple[AircraftStatus, ...]] = tuple,
        islands: int = 0,
        now: bool = False,
    ) -> None:
        """Write status.json, but not more often than useful."""
        if not now and time.monotonic() - self._written < STATUS_EACH_S:
            return
        if not now:  # while the flight waits for the disk, this would only wait as well
            self._record()
        self.accounts = accounts()
        fleet, told = aircraft(), largest(held_out(), ISLANDS_SHOWN)
        facts = self._facts(behind, islands, fleet, told)
        conditions, ending = self.conditions, state == "settling"
        status = Status(
            flight=self._flight.name,
            state=state,
            updated_utc=time.time(),
            started_utc=self._flight.started_utc,
            revision=revision,
            mavlink=tuple(self._links.values()),
            watch=self._worst_source(),
            aircraft=fleet,
            behind=behind,
            last_frame=self.last_frame,
            accounts=self.accounts,
            held_out=told,
            conditions=conditions.at_the_end(facts) if state == "stopped" else conditions.so_now(facts, ending=ending),
            notices=tuple(self._notices),
        )
        self._tell(by_the_clock(status))

    def _tell(self, status: Status) -> None:
        room = STATUS_BYTES + AIRCRAFT_BYTES * len(status.aircraft)
        self._put(compact(status_document(status)).ljust(room).encode("ascii"))
        self._written = time.monotonic()
        for notice in self.conditions.fresh():
            self.say(notice)
        if status.state != "stopped":
            self._terminal.state(in_one_line(status))

    def _worst_source(self) -> SourceReport | None:
        """The source of frames or, of several aircraft's, one that brings nothing if there is any."""
        return min(self.sources.values(), key=lambda one: one.state in BRINGING, default=None)

    def _facts(self, behind: Behind, islands: int, aircraft: tuple[AircraftStatus, ...], held_out: Figures) -> Facts:
        return Facts(
            utc=even_utc(),
            started_utc=self._begun_utc,
            links=tuple(self._links.values()),
            source=self.sources.get(None),
            sources=tuple(one for whose, one in self.sources.items() if whose is not None),
            aircraft=aircraft,
            behind=behind,
            accounts=self.accounts,
            islands=islands,
            held_out=held_out,
            of_other_cameras=len(self._ledger.shots_of_other_cameras()) if self.accounts.events.missing else 0,
        )

    def _record(self) -> None:
        """Bring notices into the ledger; those that it does not take now follow later."""
        try:
            while self._unrecorded:
                self._ledger.record_notice(*self._unrecorded[0])
                self._unrecorded.popleft()
        except (CannotWrite, sqlite3.OperationalError):  # told by the ledger's other writers
            logger.debug("a notice cannot be recorded now", exc_info=True)

    def _put(self, data: bytes) -> None:
        if not self._may_write():
            return
        try:
            write_beside(self._path, data)
        except (DiskFull, OSError):  # reported by the map's writer
            logger.debug("%s cannot be written beside", self._path.name, exc_info=True)
            with suppress(DiskFull, OSError):
                overwrite(self._path, data)


def in_one_line(status: Status) -> str:
    """How the flight is."""
    parts = [f"frames: {counted(asdict(status.accounts.frames))}", behind_in_words(status.behind)]
    if status.last_frame is not None:
        parts.append(f"last: {status.last_frame.name}, {status.last_frame.outcome}")
    return f"{status.state}; {'; '.join(parts)}"


def behind_in_words(behind: Behind) -> str:
    """For a line."""
    return f"{behind.frames} waiting, {behind.seconds:.0f} s behind" if behind.frames else "none waits"


Aircraft = int | None  # None: frames of one source for all


class Fleet:
    """The aircraft of a flight. `counted` tells those whose triggers count; `several`: whether there may be more than one."""

    def __init__(self, counted: Callable[[], Iterable[int]], ledger: Ledger, *, several: bool = True) -> None:
        self._counted, self._ledger, self._several = counted, ledger, several
        self._last: dict[Aircraft, LastFrame] = {}

    def processed(self, vehicle: Aircraft, frame: LastFrame) -> None:
        """A frame of this aircraft has had its turn."""
        self._last[vehicle] = frame

    def status(
        self, waiting: Sequence[Frame], sources: Mapping[Aircraft, SourceReport], now_s: float
    ) -> tuple[AircraftStatus, ...]:
        """Each aircraft at the monotonic time `now_s`; `waiting`: the frames whose turn has not come."""
        if not self._several:
            return ()
        accounts = self._ledger.accounts_of_aircraft()
        # Those of the ledger too: one that has flown may have landed before a resumed flight went on.
        systems = set(self._counted()) | {vehicle for vehicle in sources if vehicle is not None} | accounts.keys()
        return tuple(
            AircraftStatus(
                system=system,
                source=sources.get(system),
                behind=_behind([frame for frame in waiting if frame.vehicle == system], now_s),
                last_frame=self._last.get(system),
                **({"accounts": accounts[system]} if system in accounts else {}),
            )
            for system in sorted(systems)
        )


def _behind(waiting: Sequence[Frame], now_s: float) -> Behind:
    return Behind(frames=len(waiting), seconds=max((now_s - frame.received for frame in waiting), default=0.0))


SAID_FROM_S = 10.0  # behind: less is a burst of the camera


class Backlog:
    """Notices of one flight: one as the map falls behind, another each time that has doubled, one when it has caught up."""

    def __init__(self) -> None:
        self._said_s = 0.0  # 0: not behind

    def notice(self, behind: Behind) -> Notice | None:
        """What is to be said of the present backlog, if anything."""
        if self._said_s and not behind.frames:
            self._said_s = 0.0
            return Notice(source="daemon", level="info", text="the map has caught up: every frame has had its turn")
        if behind.seconds < max(SAID_FROM_S, 2 * self._said_s):
            return None
        self._said_s = behind.seconds
        text = f"the map is {frames_words(behind.frames)}, {behind.seconds:.0f} s behind: the newest are stitched first"
        return Notice(source="daemon", level="warning", text=text)
