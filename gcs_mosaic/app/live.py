"""Main loop of a live flight: takes input from the sources, processes it on one thread, publishes tiles and news."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from gcs_mosaic.app.driver import Driver
from gcs_mosaic.app.event_log import EventLog
from gcs_mosaic.app.flight_log import flight_log
from gcs_mosaic.app.inbox import Inbox, attach_stream, initial_report, keeping, record, watching
from gcs_mosaic.app.links import Item, Links
from gcs_mosaic.app.pipeline import Done, Pipeline
from gcs_mosaic.app.prefetch import Preparation
from gcs_mosaic.app.resuming import checkpoints_of, files_taken, later_by, saved_flight, told_again
from gcs_mosaic.app.service_manager import ServiceManager
from gcs_mosaic.app.shutdown import Shutdown
from gcs_mosaic.app.status import Reporter
from gcs_mosaic.app.statustext import Announcements
from gcs_mosaic.app.turns import AsTheyCame, NewestFirst
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame, LinkReport, Notice, SourceReport, Topic
from gcs_mosaic.stitch.transaction import Snapshot
from gcs_mosaic.store.checkpoint import Checkpoints, Unusable
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.durability import Durability
from gcs_mosaic.store.folder import (
    LEDGER_NAME,
    FlightFolder,
    open_flight_folder,
    refuse_watching_ourselves,
    resume_flight_folder,
)
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.log import said, streams_json
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.store.retry import UntilWritable
from gcs_mosaic.store.status import Behind, DaemonState, LastFrame
from gcs_mosaic.triggers.shots import CameraMessage, Shots
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer

logger = logging.getLogger(__name__)

WAIT_S = 0.2  # longest wait between checks for shutdown
IDLE_AFTER_S = 10.0  # without a new frame: time to adjust everything and repaint moved frames
TAKE_IN_S = 0.5  # then accepted frames are processed before more are accepted
CONNECT_SHARE = 4  # 1 / this share of the time left at the end may be spent on connecting islands
RETRY_S = 2.0  # between attempts to write to a full disk


def fly(config: Config, links: Links, console: Console, shutdown: Shutdown) -> None:
    """Run until stopped. Raises UsageError before anything is written if it cannot start.

    `links` are the open links of these settings; the frame sources are added to them.
    """
    watched, out = Path(config.watch), Path(config.out)
    if not config.rtsp:
        refuse_watching_ourselves(watched, out)
    with ExitStack() as stack:
        # Fail early: addresses, ports and folders in use.
        address = HttpAddress.parse(config.http) if config.http else None
        shots = Shots(config.shots)
        links.sources[:] = [replace(source, items=shots.follow(source.items)) for source in links.sources]
        if config.rtsp:
            links.sources[:] = attach_stream(config.rtsp, links.sources, config, shutdown.stop)
        folder = resume_flight_folder(out) if config.resume else open_flight_folder(out)
        stack.callback(folder.close)
        checkpoints = checkpoints_of(folder.path, config)
        if checkpoints is not None:
            stack.callback(checkpoints.close)
        saved = _saved(folder, checkpoints, config)
        stack.enter_context(flight_log(folder, config))
        recorded = record(config, links.recording, folder.path)
        feed, page = _serve(address, folder, stack)
        if not config.rtsp:
            refuse_watching_ourselves(watched, folder.path)
            links.sources.append(watching(config, shutdown.stop, _files_taken(folder)))
        console = Console(quiet=True) if streams_json(config.log) else console  # all that is said is in the log
        daemon = _Daemon(config, folder, checkpoints, console, shutdown, feed)
        stack.callback(daemon.close)
        daemon.say(Notice(source="out", level="info", text=folder.said))
        if recorded:
            daemon.say(recorded)
        if page:
            daemon.say(Notice(source="page", level="info", text=f"the map is at {page}", topic=Topic.PAGE))
        if saved:
            daemon.resume(saved, shots)
        daemon.run(links)


def _saved(folder: FlightFolder, checkpoints: Checkpoints | None, config: Config) -> Snapshot | None:
    """The saved state of the flight to resume, None for a new one. Raises UsageError."""
    if not folder.resumed:
        return None
    paper = Unusable("a map of the paper's recipe is in memory only")
    saved = paper if checkpoints is None else saved_flight(checkpoints, config)
    if isinstance(saved, Unusable):
        raise UsageError(
            f"--resume: the flight in {folder.path} cannot be gone on with: {saved.reason}. Start without --resume: the new "
            f"flight is written beside it, and gcs-mosaic stitch {folder.path / 'frames'} makes a map of what it has."
        )
    return saved


def _files_taken(folder: FlightFolder) -> dict[str, Taken] | None:
    """Files already accepted; None for a new flight."""
    if not folder.resumed:
        return None
    with Ledger(folder.path / LEDGER_NAME, read_only=True) as ledger:
        return files_taken(ledger.frames())


def _serve(address: HttpAddress | None, folder: FlightFolder, stack: ExitStack) -> tuple[Feed, str]:
    feed = Feed()
    if address is None:
        return feed, ""
    server = WebServer(folder.path, address, feed)
    page = server.start()
    stack.callback(server.stop)
    return feed, page


class _Daemon:
    def __init__(
        self,
        config: Config,
        folder: FlightFolder,
        checkpoints: Checkpoints | None,
        console: Console,
        shutdown: Shutdown,
        feed: Feed,
    ) -> None:
        self._config, self._shutdown = config, shutdown
        self._announcements = Announcements()
        self._inbox = Inbox(shutdown.stop)
        until_writable = UntilWritable(folder.path, self.say, self._wait_for_disk)
        self._pipeline = Pipeline(
            folder.path, config, self.say, feed.publish, retry=until_writable, checkpoints=checkpoints
        )
        self._driver = Driver(self._pipeline)
        self._preparation = Preparation(
            self._pipeline.features_of,
            config.reduction,
            self._pipeline.feature_pixels,
            # The paper's recipe permanently rejects a frame that does not overlap its predecessor.
            AsTheyCame() if config.method == "paper" else NewestFirst(),
            self._inbox.wake,
        )
        store = self._pipeline.store
        self._durability = Durability(store.ledger.make_durable)
        self._manager = ServiceManager()
        self._reporter = Reporter(folder.path, store.flight, store.ledger, console)
        self._reporter.watch = initial_report(config)
        self._event_log = EventLog(store.ledger, config.pairing, until_writable)
        self._came: dict[str, float] = {}  # when files were complete, by frame name
        self._last_frame = 0.0
        self._until = math.inf  # deadline for finishing
        self._state: DaemonState = "listening"
        self._adjusting = False  # whether an adjustment started in a pause is still running
        self._looked = False  # whether every file present at the start has been accepted

    def resume(self, saved: Snapshot, shots: Shots) -> None:
        """Resume the folder's flight before accepting anything new."""
        store = self._pipeline.store
        told = told_again(store.ledger.events(), store.ledger.frames(), later_by(saved))
        self._event_log.resume(told, shots, store.flight.started_utc, store.out)
        self._event_log.save()
        again = self._pipeline.resume(saved["pipeline"])
        self._driver.save()
        for frame in again:
            self._came[frame.name] = time.monotonic()
            self._preparation.append(replace(frame, received=time.monotonic()))
        self._pipeline.checkpoint(at_once=True)  # with this run's clock
        placed = store.accounts().frames.placed
        text = f"{placed} frames of it are on the map, {len(again)} are still to be placed"
        self.say(Notice(source="out", level="info", text=text))

    def run(self, links: Links) -> None:
        """Run until stopped, then finish."""
        self._announcements.speakers = links.speakers
        keep = self._pipeline.store.keep_ahead
        self._inbox.fill([keeping(source, keep) for source in links.sources])
        self._driver.save()  # so that a reader finds a map from the start, even if an empty one
        self._manager.ready()
        while not self._shutdown.stop.is_set():
            self._take_in(0.0 if self._has_work() else WAIT_S)
            self._work()
            self._announcements.missing(self._event_log.tick(time.monotonic()))
            self._event_log.save()
            self._report()
        self._manager.ending()
        self._inbox.join()
        self._finish()

    def say(self, notice: Notice) -> None:
        self._reporter.say(notice)
        self._announcements.notice(notice)

    def close(self) -> None:
        self._manager.close()
        self._durability.close()
        self._preparation.close()
        self._pipeline.close()

    # Input

    def _take_in(self, timeout_s: float) -> None:
        """Take items from the inbox while there is time; waits for the first one if it is empty."""
        until = time.monotonic() + TAKE_IN_S
        item = self._inbox.next(timeout_s)
        while item is not None:
            self._take(item)
            item = self._inbox.next(0.0) if time.monotonic() < until else None

    def _take(self, item: Item) -> None:
        match item:
            case CameraMessage(event=event):
                self._event_log.message(item, event.received)
            case Frame():
                self._take_frame(item)
            case DamagedFile():
                self._driver.accept(item)
                self.say(Notice(source="frames", level="warning", text=f"{item.name} is damaged: {item.reason}"))
            case DroppedFrame():
                self._driver.accept(item)
                self.say(Notice(source="frames", level="warning", text=f"{item.frame.name} is dropped: {item.reason}"))
            case Notice():
                self._looked |= item.topic is Topic.FIRST_LOOK
                self.say(item)
            case LinkReport():
                self._reporter.link(item)
            case SourceReport():
                self._reporter.watch = item

    def _take_frame(self, found: Frame) -> None:
        frame = self._driver.accept(found)
        # An event may name a copy of an earlier image, but the copy's time says nothing about the capture time.
        self._event_log.frame(found, time.monotonic(), fresh=self._looked and frame is not None)
        self._last_frame = time.monotonic()
        if frame is not None:
            self._came[frame.name] = found.received
            self._preparation.append(frame)

    # Processing

    def _has_work(self) -> bool:
        return self._preparation.is_ready or self._repainting()

    def _repainting(self) -> bool:
        return not len(self._preparation) and self._pipeline.has_repaints

    def _work(self) -> None:
        """Frames first; repainting only when there are none."""
        if self._preparation.is_ready:
            prepared = self._preparation.next()
            assert prepared is not None, "a frame that is ready is there"
            self._note_done(self._driver.process(prepared, self._begin_next))
            self._pipeline.checkpoint()
        elif self._repainting() and self._pipeline.repaint_some():
            self._driver.save()
        elif self._is_idle() and (self._state == "flying" or self._adjusting):
            self._state = "idle"
            self._adjust_in_a_pause()
            self._driver.save()

    def _begin_next(self, done: Done) -> None:
        """Start preparing the newest frame while this one is being written."""
        self._preparation.processed(done.name, done.on_map, waits=done.state is FrameState.WAITING)
        self._take_in(0.0)
        self._preparation.begin()

    def _adjust_in_a_pause(self) -> None:
        self._adjusting = False
        try:
            self._adjusting = self._pipeline.adjust_in_a_pause()
        except Exception as error:  # without this improvement the map is still valid
            logger.exception("the map could not be adjusted in a pause")
            self.say(Notice(source="daemon", level="error", text=f"the map could not be adjusted ({error!r})"))

    def _is_idle(self) -> bool:
        return not len(self._preparation) and time.monotonic() - self._last_frame > IDLE_AFTER_S

    def _note_done(self, done: Done) -> None:
        self._state = "flying"
        self._announcements.frame(done.state)
        latency = time.monotonic() - self._came.pop(done.name)
        self._reporter.last_frame = LastFrame(
            name=done.name,
            outcome=done.state,
            island=done.island,
            utc=time.time(),
            seconds_to_tile=latency if done.state is FrameState.PLACED else None,
            reason=done.reason,
            covered_by=done.covered_by,
        )
        where = f" on island {done.island}" if done.island else f" by {done.covered_by}" if done.covered_by else ""
        why = f" ({done.reason})" if done.reason else ""
        seconds = ", ".join(f"{stage} {taken:.2f} s" for stage, taken in done.seconds.items())
        fields = {"frame": done.name, "state": done.state, "latency_s": round(latency, 3), "seconds": done.seconds}
        logger.info("%s: %.1f s after it came; %s", done.name, latency, seconds, extra=said(**fields))
        self._reporter.line(f"{done.name} {done.state}{where}{why}, {latency:.1f} s after it came")

    # Shutdown

    def _finish(self) -> None:
        """Process what has arrived, adjust and paint a last time, close the accounts."""
        self._state = "settling"
        self._take_in_the_rest()
        self.say(Notice(source="daemon", level="info", text=self._farewell()))
        while len(self._preparation) and self._may_go_on():
            self._preparation.wait(WAIT_S)
            self._work()
            self._report()
        self._say_what_is_left()
        self._paint_final()
        self._event_log.close()
        self._event_log.save()
        self._driver.save()
        self._pipeline.checkpoint(at_once=True)
        self._state = "stopped"
        self._report(now=True)
        self._reporter.judge(self._pipeline.mosaic.held_out())

    def _take_in_the_rest(self) -> None:
        while len(self._inbox) and self._may_go_on():
            self._take_in(0.0)
            self._report()
        if len(self._inbox):
            text = f"{len(self._inbox)} files and messages that came last were left out, there was no time for them"
            self.say(Notice(source="daemon", level="warning", text=text))

    def _say_what_is_left(self) -> None:
        if left := len(self._preparation):
            kept = self._pipeline.store.out / "frames"
            text = f"{left} frames are not on the map, there was no time: gcs-mosaic stitch {kept} makes one of all"
            self.say(Notice(source="daemon", level="warning", text=text))

    def _paint_final(self) -> None:
        try:
            for _ in self._pipeline.settle(self._time_to_connect()):
                self._report()
            if self._may_go_on():
                self._repaint_all()
        except Exception as error:  # close the accounts anyway
            logger.exception("the final painting has failed")
            text = f"the final painting has failed, the map stays as it was in flight ({error!r})"
            self.say(Notice(source="daemon", level="error", text=text))

    def _repaint_all(self) -> None:
        for _ in self._pipeline.repaint_all():
            self._report()
            if not self._may_go_on():
                break

    def _time_to_connect(self) -> Callable[[], bool]:
        """Whether there is time left to connect islands: a share of the remaining time, none when hurried."""
        self._may_go_on()  # sets the deadline
        now = time.monotonic()
        until = now + (self._until - now) / CONNECT_SHARE
        return lambda: self._may_go_on() and time.monotonic() < until

    def _may_go_on(self) -> bool:
        """Whether to continue: always until stopped, then for as long as the settings allow."""
        if self._shutdown.stop.is_set() and math.isinf(self._until):
            self._until = time.monotonic() + self._config.finish_s
        return not self._shutdown.hurry.is_set() and time.monotonic() < self._until

    def _wait_for_disk(self, trouble: CannotWrite) -> None:
        """Pause between two attempts to write; limited at the end."""
        self._report(now=True)
        self._shutdown.hurry.wait(RETRY_S)
        if not self._may_go_on():
            raise trouble

    def _farewell(self) -> str:
        left = f"working off {len(self._preparation)} frames, then " if len(self._preparation) else ""
        return f"ending: {left}painting the final map, at most {self._config.finish_s:g} s (again Ctrl-C: at once)"

    # Output

    def _report(self, *, now: bool = False) -> None:
        pipeline, waiting = self._pipeline, self._preparation
        behind = Behind(frames=len(waiting), seconds=waiting.behind_s(time.monotonic()))
        counted, revision = pipeline.accounts, pipeline.store.revision
        self._reporter.write(self._state, behind, revision, counted, pipeline.mosaic.held_out, now=now)
        self._manager.alive()
        self._manager.status(
            f"{self._state}: {self._reporter.accounts.frames.placed} frames placed, {_in_words(behind)}"
        )


def _in_words(behind: Behind) -> str:
    return f"{behind.frames} waiting, {behind.seconds:.0f} s behind" if behind.frames else "none waits"
