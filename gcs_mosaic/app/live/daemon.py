"""Main loop of a live flight: takes input from the sources, processes it on one thread, publishes tiles and news."""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from gcs_mosaic.app.inputs.event_log import EventLog
from gcs_mosaic.app.inputs.frame_sources import (
    FrameSource,
    elsewhere,
    frame_sources,
    refuse_our_own,
    watched_folders,
    with_streams,
)
from gcs_mosaic.app.inputs.inbox import Inbox, is_shot, keeping, record
from gcs_mosaic.app.inputs.links import Item, ItemSource, Links
from gcs_mosaic.app.inputs.pairing_check import contradiction_text
from gcs_mosaic.app.live.flight_page import FlightPage
from gcs_mosaic.app.live.left_behind import (
    LeftBehind,
    left_out_words,
    not_kept_words,
    unpainted_words,
    unstitched_words,
)
from gcs_mosaic.app.live.operator_requests import OperatorRequests
from gcs_mosaic.app.live.output import OutputFolder
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.pipeline.resuming import OpenedFlight, open_flight, runs_of, told_again
from gcs_mosaic.app.pipeline.rewritten import PREVIEW, SeenPictures, as_whole_of_damaged, taken_as_rewritten
from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.app.status.reporter import Backlog, Fleet, Reporter, behind_in_words
from gcs_mosaic.app.status.service_manager import ServiceManager
from gcs_mosaic.app.status.statustext import Announcements
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, Preparation, UndecodableFrame
from gcs_mosaic.app.waiting.turns import AsTheyCame, InTurn, NewestFirst, Turns, prepared_at_once
from gcs_mosaic.app.waiting.unread import UnreadFrames
from gcs_mosaic.config.tree import Config
from gcs_mosaic.even_clock import even_utc
from gcs_mosaic.frames.video.watched import Room
from gcs_mosaic.mavlink.tlog_writer import Recording
from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame, LinkReport, Notice, OtherFile, SourceReport, Topic
from gcs_mosaic.notes.anchors.anchor_setting import let_positions_lay
from gcs_mosaic.stitch.transaction import Snapshot
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.flight_store import StoreHooks
from gcs_mosaic.store.folder import FlightFolder
from gcs_mosaic.store.log import LogFile, said, streams_json
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.store.retry import UntilWritable
from gcs_mosaic.store.status import AircraftStatus, Behind, LastFrame, frames_words
from gcs_mosaic.store.told_documents import DaemonState
from gcs_mosaic.store.typed import typed
from gcs_mosaic.triggers.shots import CameraMessage, Shots
from gcs_mosaic.web.address import HttpAddress

logger = logging.getLogger(__name__)

WAIT_S = 0.2  # longest wait between checks for shutdown
IDLE_AFTER_S = 10.0  # without a new frame: time to adjust everything and repaint moved frames
LANDED_AFTER_S = (
    20.0  # without a new frame: time to show the whole map as at the end; Ctrl-C then has little left to do
)
TAKE_IN_S = 0.5  # then accepted frames are processed before more are accepted
CONNECT_SHARE = 4  # 1 / this share of the time left at the end may be spent on connecting islands
RETRY_S = 2.0  # between attempts to write to a full disk
DISK_EACH_S = 1.0  # between looks at the output folder while nothing is written
LOST_S = 0.2  # then other work is looked for


def fly(config: Config, links: Links, console: Console, shutdown: Shutdown) -> None:
    """Run until stopped. Raises UsageError before anything is written if it cannot start.

    `links` are the open links of these settings; the frame sources are added to them.
    """
    sources = frame_sources(config)
    refuse_our_own(sources, Path(config.out))
    links.choice.count(config.aircraft)
    with ExitStack() as stack:
        # Fail early: addresses, ports and folders in use.
        address = HttpAddress.parse(config.http) if config.http else None
        shots = Shots(config.shots, lambda: links.trust.sources)
        heard = [replace(link, items=shots.follow(link.items)) for link in links.sources]
        heard_and_streams = with_streams(heard, sources, links.trust, shutdown.stop)
        opened = open_flight(config)
        stack.callback(opened.close)
        folder = opened.folder
        log = stack.enter_context(flight_log(folder, config))
        recorded = record(config, links.recording, folder.path)
        page = FlightPage(config, address, folder.path)
        stack.callback(page.stop)
        told = [Notice(source="out", level="info", text=folder.said), *_began(config, folder, recorded), *page.wait()]
        refuse_our_own(sources, folder.path)
        room = Room()
        inputs = [*heard_and_streams, *watched_folders(sources, folder, shutdown.stop, room)]
        reopen = _reopening(log, links.recording, config)
        console = Console(quiet=True) if streams_json(config.log) else console  # all that is said is in the log
        daemon = _Daemon(_Parts(config, opened, links, sources, page, room, reopen), console, shutdown)
        stack.callback(daemon.close)
        for notice in told:
            daemon.say(notice)
        page.invite(console)
        try:
            if folder.resumed:
                daemon.resume(opened.saved, shots)
            daemon.run(inputs)
        except CannotWrite as trouble:  # the operator has not waited until it was over
            raise daemon.cut_short(trouble) from trouble


def _began(config: Config, folder: FlightFolder, recorded: Notice | None) -> list[Notice]:
    """What to say of what goes on beside the map from now on."""
    laid = [let_positions_lay(folder.path)] if config.anchor == "positions" else []
    return [recorded, *laid] if recorded else laid


def _preparation_of(config: Config, pipeline: Pipeline, woken: Callable[[], None]) -> Preparation:
    turns = AsTheyCame() if pipeline.mosaic.in_order else _turns_of(config)
    given = pipeline.features_of, pipeline.decoders, config.reduction, pipeline.feature_pixels, turns, woken
    # Where frames come too fast, one that is chosen early is old when it comes on the map.
    return Preparation(*given, at_once=prepared_at_once(os.cpu_count() or 1))


def _turns_of(config: Config) -> Turns:
    return InTurn(prepared_at_once(os.cpu_count() or 1)) if config.sources else NewestFirst()


def _reopening(log: LogFile, recording: Recording, config: Config) -> Callable[[], None]:
    """Opens again, in a folder that was made anew, the files that stay open for the whole flight."""

    def reopen() -> None:
        log.reopen()
        if config.record is True:
            recording.reopen()

    return reopen


@dataclass(frozen=True, slots=True)
class _Parts:
    """What a live flight is made of, in the order in which `fly` makes it; `reopen`: see `OutputFolder`."""

    config: Config
    opened: OpenedFlight
    links: Links
    sources: Sequence[FrameSource]
    page: FlightPage
    room: Room
    reopen: Callable[[], None] = lambda: None


class _Daemon:
    def __init__(self, parts: _Parts, console: Console, shutdown: Shutdown) -> None:
        config, opened, links = parts.config, parts.opened, parts.links
        self._config, self._shutdown, self._links = config, shutdown, links
        self._page, self._room, self._sources = parts.page, parts.room, parts.sources
        self._announcements = Announcements(links.speakers)
        self._backlog = Backlog()
        self._inbox = Inbox(shutdown.stop)
        out = opened.folder.path
        self._until_writable = UntilWritable(out, self.say, self._wait_for_disk, lambda: self._output.ensure())
        self._pipeline = self._pipeline_in(opened)
        self._driver = Driver(self._pipeline)
        self._preparation = _preparation_of(config, self._pipeline, self._inbox.wake)
        store = self._pipeline.store
        self._manager = ServiceManager()
        self._output = OutputFolder(opened.folder, config, self._pipeline, parts.reopen, self.say)
        self._unread = UnreadFrames(store.found_again)
        told = {"each_frame": config.log.verbose}
        self._reporter = Reporter(out, store.flight, store.ledger, console, self._output.is_ours, **told)
        for source in self._sources:
            self._reporter.source(source.report)
        apart, several = bool(config.sources), bool(config.aircraft)
        self._event_log = EventLog(store.ledger, config.pairing, self._until_writable, links.trust, apart=apart)
        self._fleet = Fleet(lambda: links.choice.counted, store.ledger, several=several)
        self._seen = SeenPictures()
        self._said_damaged = set[str]()  # files, by the names that their frames will have
        self._came: dict[str, float] = {}  # when files were complete, by frame name
        self._last_frame = 0.0
        self._until = math.inf  # deadline for finishing
        self._state: DaemonState = "listening"
        self._adjusting = False  # whether an adjustment started in a pause is still running
        self._unsettled = False  # whether frames were painted since the whole map was last shown as at the end
        self._disk_due = 0.0
        self._said_waiting = False  # that the end waits for the disk
        self._in_hand: Item | None = None  # taken from the inbox, and not written down yet
        self._looked = set[int | None]()  # aircraft of whose source each file that was there at the start is accepted

    def _pipeline_in(self, opened: OpenedFlight) -> Pipeline:
        return Pipeline(
            opened.folder.path,
            self._config,
            self.say,
            StoreHooks(
                published=self._page.publish,
                retry=self._until_writable,
                elsewhere=lambda name: elsewhere(self._sources, name),
                may_write=lambda: self._output.is_ours(),
            ),
            paint_first=True,
            checkpoints=opened.checkpoints,
            shelf=opened.shelf,
        )

    def resume(self, saved: Snapshot | None, shots: Shots) -> None:
        """Resume the folder's flight before accepting anything new."""
        store = self._pipeline.store
        told = told_again(store.ledger.events(), store.ledger.frames(), runs_of(saved))
        self._event_log.resume(told, shots, store.flight.started_utc, store.out)
        self._event_log.save()
        again = self._pipeline.resume(saved)
        self._driver.save()
        for frame in again:
            self._came[frame.name] = time.monotonic()
            self._preparation.append(replace(frame, received=time.monotonic()))
        self._unsettled = True
        self._pipeline.checkpoint(at_once=True)  # with this run's clock
        placed = store.accounts().frames.placed
        text = f"{placed} frames of it are on the map, {len(again)} are still to be placed"
        self.say(Notice(source="out", level="info", text=text))

    def run(self, inputs: Iterable[ItemSource]) -> None:
        """Take in what these bring until stopped, then finish."""
        requests = OperatorRequests(self._pipeline.store.out, self._links.choice, self.say)
        self._inbox.fill([keeping(source, self._keep) for source in inputs])
        self._driver.save()  # so that a reader finds a map from the start, even if an empty one
        self._pipeline.checkpoint(at_once=True)  # and that this is known to be a flight that can be resumed
        self._manager.ready()
        while not self._shutdown.stop.is_set():
            self._take_in(0.0 if self._has_work() else WAIT_S)
            self._room.note(len(self._preparation) + len(self._inbox))
            self._work()
            self._announcements.missing(self._event_log.tick(self._inbox.taken_until(time.monotonic())))
            self._event_log.save()
            self._reporter.conditions.pairing = self._ambiguous()
            requests.look(time.monotonic())
            self._look_after_disk()
            self._report()
        self._manager.ending()
        self._inbox.join()
        self._finish()

    def say(self, notice: Notice) -> None:
        self._reporter.say(notice)
        self._announcements.notice(notice)

    def close(self) -> None:
        self._reporter.close()
        self._manager.close()
        self._output.close()
        self._preparation.close()
        self._pipeline.close()

    # Input

    def _keep(self, found: Frame) -> Frame:
        """Keep the original of a frame that goes to the inbox, and begin to prepare it; on its source's thread."""
        kept = self._pipeline.store.keep_ahead(found)
        self._preparation.expect(kept)
        return kept

    def _take_in(self, timeout_s: float) -> None:
        """Take items from the inbox while there is time; waits for the first one if it is empty."""
        until = time.monotonic() + TAKE_IN_S
        item = self._inbox.next(timeout_s)
        while item is not None:
            self._in_hand = item
            self._take(item)
            self._in_hand = None
            item = self._inbox.next(0.0) if time.monotonic() < until else None
        self._pipeline.store.tell_accounts()

    def _take(self, item: Item) -> None:
        match item:
            case CameraMessage(event=event):
                self._event_log.message(item, event.received)
            case Frame():
                self._take_frame(item)
                self._preparation.forget_expected(item)
            case DamagedFile():
                self._driver.accept(item)
                self._said_damaged.add(item.name)
                self.say(Notice(source="frames", level="warning", text=f"{item.name} is damaged: {item.reason}"))
            case DroppedFrame():
                self._driver.accept(item)
                self._preparation.forget_expected(item.frame)
                self.say(Notice(source="frames", level="warning", text=f"{item.frame.name} is dropped: {item.reason}"))
            case OtherFile():
                self._pipeline.store.accept_other(item)
            case Notice():
                self._looked |= {item.vehicle} if item.topic is Topic.FIRST_LOOK else set()
                self.say(item)
            case LinkReport():
                self._reporter.link(item)
            case SourceReport():
                self._reporter.source(item)

    def _take_frame(self, found: Frame) -> None:
        if taken_as_rewritten(self._pipeline.store, found):
            return
        found = as_whole_of_damaged(self._pipeline.store, found)
        self._take_back_damage(found.name)
        self._set_preview_aside(found)
        if came_meanwhile := found.vehicle not in self._looked and self._came_while_starting(found):
            appeared = time.monotonic() - (time.time() - found.modified)
            found = replace(found, received=min(found.received, appeared))
        frame = self._driver.accept(found)
        self._last_frame = time.monotonic()
        if frame is None:
            self._event_log.copy(found, time.monotonic(), of=self._pipeline.store.shown_by(found))
            return
        fresh = found.vehicle in self._looked or came_meanwhile
        self._event_log.frame(found, time.monotonic(), fresh=fresh)
        self._came[frame.name] = found.received
        self._preparation.append(frame)

    def _take_back_damage(self, name: str) -> None:
        """Say that a file is whole, if it was told as damaged: an upload may take longer than one waits for it."""
        if name in self._said_damaged:
            self._said_damaged.remove(name)
            text = f"{name} has come whole after all: it is taken as any other"
            self.say(Notice(source="frames", level="info", text=text))

    def _came_while_starting(self, found: Frame) -> bool:
        """Whether a file that was there at the first look was written since the links are heard: its trigger was heard, too."""
        return self._links.since_utc <= found.modified <= time.time() + 1.0

    def _set_preview_aside(self, whole: Frame) -> None:
        """Of a file whose whole picture has come: the preview is not stitched, or stays until the whole picture has a place."""
        if not whole.is_whole_of_earlier or whole.earlier is None:
            return
        self._pipeline.store.note_beside(whole.earlier, PREVIEW)
        if self._preparation.withdraw(whole.earlier):
            self._came.pop(whole.earlier, None)
            self._pipeline.skip(whole.earlier, f"a smaller preview of {whole.name}")
        else:
            self._pipeline.note_whole(whole.earlier, whole.name)

    def _set_aside_as_again(self, frame: Frame) -> None:
        """Its file held the same pixels before, in another encoding."""
        self._came.pop(frame.name, None)
        self._event_log.withdraw(frame)
        self._pipeline.store.note_beside(frame.name, "written again")
        self._pipeline.skip(frame.name, f"the same picture as {frame.earlier}, written again")
        self._driver.save()

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
            if isinstance(prepared, UndecodableFrame) and self._unread.add(prepared, time.monotonic()):
                return
            if isinstance(prepared, DecodedFrame) and self._seen.is_again(prepared):
                self._set_aside_as_again(prepared.frame)
                return
            self._note_done(self._driver.process(prepared, self._begin_next), prepared.frame.vehicle)
            self._pipeline.adjust()
            self._driver.save()
            self._pipeline.checkpoint()
        elif self._is_idle() and (self._state == "flying" or self._adjusting):
            self._state = "idle"
            self._adjust_in_a_pause()
            if not self._driver.repaint_some(self._begin):
                self._driver.save()
        elif self._unsettled and self._is_idle(LANDED_AFTER_S):
            self._unsettled = False
            self._pipeline.settle_in_a_pause()
            self._driver.save()
        elif self._repainting():
            self._driver.repaint_some(self._begin)

    def _begin_next(self, done: Done) -> None:
        """Start preparing the newest frame while this one is being written."""
        self._preparation.processed(done.name, done.on_map, waits=done.state is FrameState.WAITING)
        self._begin()

    def _begin(self) -> None:
        """Start preparing what has just come, while what is painted is being written."""
        self._take_in(0.0)
        self._preparation.begin()

    def _adjust_in_a_pause(self) -> None:
        self._adjusting = False
        try:
            self._adjusting = self._pipeline.adjust_in_a_pause()
        except Exception as error:  # without this improvement the map is still valid
            logger.exception("the map could not be adjusted in a pause")
            self.say(Notice(source="daemon", level="error", text=f"the map could not be adjusted ({error!r})"))

    def _is_idle(self, after_s: float = IDLE_AFTER_S) -> bool:
        return not len(self._preparation) and time.monotonic() - self._last_frame > after_s

    def _note_done(self, done: Done, vehicle: int | None) -> None:
        self._state, self._unsettled = "settling" if self._shutdown.stop.is_set() else "flying", True
        self._announcements.frame(done.state, vehicle)
        self._reporter.conditions.frame(done.state, vehicle)
        latency = time.monotonic() - self._came.pop(done.name)
        last = LastFrame(
            name=done.name,
            outcome=done.state,
            island=done.island,
            utc=even_utc(),
            seconds_to_tile=latency if done.state is FrameState.PLACED else None,
            reason=done.reason,
            covered_by=done.covered_by,
        )
        self._fleet.processed(vehicle, last)
        where = f" on island {done.island}" if done.island else f" by {done.covered_by}" if done.covered_by else ""
        why = f" ({done.reason})" if done.reason else ""
        seconds = ", ".join(f"{stage} {taken:.2f} s" for stage, taken in done.seconds.items())
        fields = {"frame": done.name, "state": done.state, "latency_s": round(latency, 3), "seconds": done.seconds}
        logger.info("%s: %.1f s after it came; %s", done.name, latency, seconds, extra=said(**fields))
        self._reporter.frame(last, f"{done.name} {done.state}{where}{why}, {latency:.1f} s after it came")

    # The disk

    def _look_after_disk(self) -> None:
        """See that the folder is there even if nothing is written; once a second is enough."""
        now = time.monotonic()
        for frame in self._unread.readable(now):
            self._preparation.append(frame)
        if now < self._disk_due:
            return
        self._disk_due = now + DISK_EACH_S
        self._until_writable(lambda: None)
        self._reporter.conditions.disk = None
        self._output.report()
        self._keep_lost_originals(now + (0.0 if len(self._preparation) else LOST_S))

    def _keep_lost_originals(self, until: float) -> None:
        """Those that are not kept: one at each look while frames wait, else as many as there is time for."""
        for notice in self._pipeline.keep_lost_originals(until):
            self.say(notice)

    def _wait_for_disk(self, trouble: CannotWrite) -> None:
        """Pause between two attempts to write; limited at the end."""
        self._reporter.conditions.disk = str(trouble)
        stop, hurry = self._shutdown.stop, self._shutdown.hurry
        if stop.is_set() and not self._said_waiting:
            self._state, self._said_waiting = "settling", True
            text = f"ending: the disk is waited for, at most {self._config.finish_s:g} s (again Ctrl-C: at once)"
            self.say(Notice(source="daemon", level="warning", text=text))
            self._manager.ending()
        self._report(now=True)
        (hurry if stop.is_set() else stop).wait(RETRY_S)
        if not self._may_go_on():
            raise trouble

    def cut_short(self, trouble: CannotWrite) -> CannotWrite:
        """The flight ends although what it has could not be written: the last words about it."""
        frames = [one for one in (*self._inbox.frames(), self._in_hand) if isinstance(one, Frame)]
        lost = sum(not one.path.is_file() for one in frames)
        left = LeftBehind(
            frames=self._reporter.accounts.frames.pending + len(frames) - lost,
            pictures_lost=lost,
            triggers_lost=self._inbox.shots() + is_shot(self._in_hand),
        )
        words = left.last_words(trouble, self._pipeline.store.out)
        self._state = "stopped"
        self._reporter.conditions.left["disk"] = words
        self._report(now=True)
        return CannotWrite(words)

    # Shutdown

    def _finish(self) -> None:
        """Process what has arrived, adjust and paint a last time, close the accounts."""
        self._state = "settling"
        self._take_in_the_rest()
        self.say(Notice(source="daemon", level="info", text=self._farewell()))
        while len(self._preparation) and self._may_go_on():
            self._preparation.wait(WAIT_S)
            self._work()
            self._look_after_disk()
            self._report()
        self._give_up_unread()
        self._say_what_is_left()
        self._seek_originals_again()
        self._paint_final()
        self._seek_originals_again()
        self._say_what_is_not_kept()
        self._event_log.close()
        self._event_log.save()
        self._driver.save()
        if ambiguous := self._ambiguous() or contradiction_text(self._pipeline.store.ledger, self._pipeline.store.out):
            self.say(Notice(source="pairing", level="warning", text=ambiguous))
        self._reporter.conditions.pairing = ambiguous
        self._pipeline.checkpoint(at_once=True)
        self._until_writable(self._output.verify)
        self._state = "stopped"
        self._report(now=True)
        self._reporter.judge(self._pipeline.mosaic.held_out())

    def _ambiguous(self) -> str | None:
        """Which triggers and pictures may as well belong together otherwise, and what to do."""
        doubts = self._event_log.doubts
        return doubts.text(typed(self._pipeline.store.out)) if doubts else None

    def _take_in_the_rest(self) -> None:
        while len(self._inbox) and self._may_go_on():
            self._take_in(0.0)
            self._report()
        if left := len(self._inbox):
            self._ends_without("left out", Notice(source="daemon", level="warning", text=left_out_words(left)))

    def _say_what_is_left(self) -> None:
        store = self._pipeline.store
        if left := store.settle_unstitched():
            text = unstitched_words(left, store.out)
            self._ends_without("unstitched", Notice(source="daemon", level="warning", text=text))

    def _ends_without(self, what: str, notice: Notice) -> None:
        """Something that is said at the end, and stays so."""
        self.say(notice)
        self._reporter.conditions.left[what] = notice.text

    def _seek_originals_again(self) -> None:
        self._pipeline.store.seek_originals_now()
        self._keep_lost_originals(self._until)

    def _say_what_is_not_kept(self) -> None:
        if left := self._pipeline.store.not_kept():
            text = not_kept_words(left, self._pipeline.store.out)
            self._ends_without("originals", Notice(source="originals", level="warning", text=text))

    def _give_up_unread(self) -> None:
        for failed in self._unread.rest():
            self._note_done(self._driver.process(failed), failed.frame.vehicle)

    def _paint_final(self) -> None:
        try:
            for _ in self._pipeline.settle(self._time_to_connect()):
                self._report()
            self._repaint_all()
        except CannotWrite:
            raise
        except Exception as error:  # close the accounts anyway
            logger.exception("the final painting has failed")
            text = f"the final painting has failed, the map stays as it was in flight ({error!r})"
            self.say(Notice(source="daemon", level="error", text=text))

    def _repaint_all(self) -> None:
        """As far as there is time."""
        steps = self._driver.repaint_all()
        while self._may_go_on():
            if next(steps, False) is False:
                return
            self._report()
        text = unpainted_words(self._pipeline.store.out)
        self._ends_without("unpainted", Notice(source="daemon", level="warning", text=text))

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

    def _farewell(self) -> str:
        count = len(self._preparation)
        left = f"working off {frames_words(count)}, then " if count else ""
        return f"ending: {left}painting the final map, at most {self._config.finish_s:g} s (again Ctrl-C: at once)"

    # Output

    def _report(self, *, now: bool = False) -> None:
        for notice in self._page.news():
            self.say(notice)
        pipeline = self._pipeline
        pipeline.tell_troubles()
        self._reporter.conditions.old_range = pipeline.shows_old_range
        behind = self._behind(time.monotonic())
        if told := self._backlog.notice(behind):
            self.say(told)
        counted, revision = pipeline.accounts, pipeline.store.revision
        islands, held_out = len(pipeline.mosaic.frame_counts()), pipeline.mosaic.held_out
        fleet = self._of_aircraft
        self._reporter.write(self._state, behind, revision, counted, held_out, aircraft=fleet, islands=islands, now=now)
        self._manager.alive()
        self._manager.status(
            f"{self._state}: {self._reporter.accounts.frames.placed} frames placed, {behind_in_words(behind)}"
        )

    def _of_aircraft(self) -> tuple[AircraftStatus, ...]:
        waiting = [*self._preparation.waiting(), *self._inbox.frames()]
        return self._fleet.status(waiting, self._reporter.sources, time.monotonic())

    def _behind(self, now_s: float) -> Behind:
        waiting, coming = self._preparation, self._inbox.frames()  # more than a few only while the disk is waited for
        seconds = max(waiting.behind_s(now_s), *(now_s - frame.received for frame in coming[:1]), 0.0)
        return Behind(frames=len(waiting) + len(self._unread) + len(coming), seconds=seconds)
