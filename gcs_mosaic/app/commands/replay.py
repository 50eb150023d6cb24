"""`gcs-mosaic replay`: a recorded flight through the same code as a live one, with a reproducible result.

Time is the recording's own, independent of the wall clock, and adjustments come after fixed numbers of frames.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from rich.console import Console

from gcs_mosaic.app.commands.batch import prefetching, say, summarise, tell
from gcs_mosaic.app.commands.replay_timing import FILE_TIMES, Arrivals, arrivals
from gcs_mosaic.app.inputs.event_log import EventLog
from gcs_mosaic.app.inputs.frame_sources import frame_sources
from gcs_mosaic.app.inputs.pairing_check import contradiction_text
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.app.status.run_progress import RunProgress
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, Preparation, UndecodableFrame
from gcs_mosaic.app.waiting.turns import AHEAD
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.aircraft_source import marked
from gcs_mosaic.frames.decoding.proof import Proof
from gcs_mosaic.frames.files import looks_in, mapped_of, read_frame
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.mavlink.tlog_reader import RecordedLink, read_recording
from gcs_mosaic.messages import DamagedFile, Frame, Notice
from gcs_mosaic.notes.anchors.anchor_setting import let_positions_lay
from gcs_mosaic.store.flight_store import StoreHooks
from gcs_mosaic.store.folder import open_flight_folder
from gcs_mosaic.store.told_documents import EventAccount
from gcs_mosaic.store.typed import typed
from gcs_mosaic.triggers.shots import CameraMessage, Shots

_FOUND_AFTER = 1.5  # looks: a file is accepted at the second look that finds it unchanged


@dataclass(frozen=True, slots=True)
class ComingFile:
    """A file, and whether it arrived in the flight. `vehicle`: whose it is, None in a folder for all."""

    look: Look
    fresh: bool
    vehicle: int | None


Happening: TypeAlias = tuple[float, CameraMessage | Notice | ComingFile]
"""Time in seconds of the recording, and what comes then."""


@dataclass(frozen=True, slots=True)
class FramesFolder:
    """The images of one aircraft, or of all."""

    vehicle: int | None
    looks: Sequence[Look]
    passed_over: Sequence[str]


def replay(
    recording: Path, frames: Path | None, out: Path, config: Config, console: Console, speed: float = 0.0
) -> Path:
    """Fly `recording` again with the images in `frames`; returns the flight's folder. `frames` is None where each aircraft has
    a folder of its own, as told by `config.sources`.

    `speed` is relative to real time; 0 means as fast as possible. Raises UsageError before anything is written.
    """
    if not 0 <= speed < math.inf:
        raise UsageError(f"--speed {speed:g} is not understood: give 1 for as it was flown, 2 for twice as fast, or 0.")
    folders = _folders(frames, config)
    with RunProgress(console) as progress:
        link = _read(recording, config, progress)
        heard = _merged(link, config)
        came = [_came(one, link, heard, config) for one in folders]
        folder = open_flight_folder(out)
        with closing(folder), flight_log(folder, config), progress.kept_in(folder.path, "replay"):
            for text in (folder.said, _described(link, folders, came)):
                say(console, Notice(source="replay", level="info", text=text))
            for text in (text for one in folders for text in one.passed_over):
                say(console, Notice(source="frames", level="warning", text=text))
            for doubts in (told.doubts for told in came if told.doubts):
                say(console, Notice(source="pairing", level="warning", text=doubts.text(typed(folder.path))))
            by_times = all(told.told_by == FILE_TIMES for told in came)
            with closing(_Replay(folder.path, config, console, link, judges=by_times)) as flight:
                if config.anchor == "positions":
                    say(console, let_positions_lay(folder.path))
                start = time.monotonic()
                done = flight.fly(_happenings(heard, folders, came), speed, progress)
                flight.summarise(done, time.monotonic() - start)
    return folder.path


def _folders(frames: Path | None, config: Config) -> list[FramesFolder]:
    """Raises UsageError for a folder without images, and for one that two aircraft share."""
    if frames is not None:
        return [_folder(frames, config)]
    return [_folder(Path(one.config.watch), one.config, one.vehicle) for one in frame_sources(config)]


def _folder(path: Path, config: Config, vehicle: int | None = None) -> FramesFolder:
    looks, passed_over = looks_in(path)
    mapped, said = mapped_of(looks, config.frames.cameras)
    return FramesFolder(vehicle, mapped, [*passed_over, *said])


def _read(recording: Path, config: Config, progress: RunProgress) -> RecordedLink:
    size = recording.stat().st_size if recording.is_file() else None
    task = progress.add_task(f"reading {recording.name}", total=size)
    link = read_recording(recording, config.link, lambda read: progress.update(task, completed=read), config.aircraft)
    progress.remove_task(task)
    return link


def _merged(link: RecordedLink, config: Config) -> list[tuple[float, CameraMessage | Notice]]:
    """Recorded camera messages and notices, in order."""
    shots, merged = Shots(config.shots), list[tuple[float, CameraMessage | Notice]]()
    for at, what in link.heard:
        merged += [(at, one) for one in shots.follow(iter([what]))]
    return merged


def _came(
    folder: FramesFolder, link: RecordedLink, heard: Sequence[tuple[float, CameraMessage | Notice]], config: Config
) -> Arrivals:
    """When the files of a folder came, by what was heard of its own aircraft alone."""
    messages = [what for _, what in heard if isinstance(what, CameraMessage)]
    if folder.vehicle is not None:
        messages = [message for message in messages if message.event.vehicle == folder.vehicle]
        link = replace(link, heard=[(message.event.received, message.event) for message in messages])
    return arrivals(folder.looks, link, messages, _FOUND_AFTER * config.frames.poll_s)


def _happenings(
    heard: Sequence[tuple[float, CameraMessage | Notice]], folders: Sequence[FramesFolder], came: Sequence[Arrivals]
) -> list[Happening]:
    """All happenings in order; a message precedes a file of the same time."""
    files = [
        (seconds, ComingFile(look, fresh, folder.vehicle))
        for folder, told in zip(folders, came, strict=True)
        for seconds, look, fresh in zip(told.seconds, folder.looks, told.fresh, strict=True)
    ]
    return sorted([*heard, *files], key=lambda happening: happening[0])  # stable, so ties keep this order


def _described(link: RecordedLink, folders: Sequence[FramesFolder], came: Sequence[Arrivals]) -> str:
    what = f"{link.packets} packets of {link.seconds:.0f} s with {len(link.events)} camera messages"
    files = [
        f"{len(folder.looks)} files{'' if folder.vehicle is None else f' of aircraft {folder.vehicle}'}, "
        f"which came as told by {told.told_by}"
        for folder, told in zip(folders, came, strict=True)
    ]
    return "; ".join([what, *files])


class _Replay:
    def __init__(self, out: Path, config: Config, console: Console, link: RecordedLink, *, judges: bool) -> None:
        """`judges`: whether files come when they came, so that their times tell something of which shots they are."""
        # A finished folder is no longer written to, so its frames need no copies.
        linking = replace(config, originals=replace(config.originals, keep="link"))
        self._config, self._console, self._now = config, console, 0.0
        began_utc = link.began_utc or 0.0
        around = StoreHooks(utc=lambda: began_utc + self._now)
        self._pipeline = Pipeline(out, linking, self._say, around, punctual=True)
        self._driver = Driver(self._pipeline)
        self._event_log = EventLog(self._pipeline.store.ledger, config.pairing, apart=bool(config.sources))
        self._done: list[Done] = []
        self._judges = judges

    def fly(self, happenings: Sequence[Happening], speed: float, progress: RunProgress) -> list[Done]:
        """Process all happenings, then paint a last time; returns the frames' outcomes."""
        coming = [what for _, what in happenings if isinstance(what, ComingFile)]
        task, start = progress.add_task("flying", total=len(coming)), time.monotonic()
        with closing(_ReadAhead(coming, self._config, prefetching(self._pipeline, self._config))) as files:
            for seconds, what in happenings:
                if speed:
                    time.sleep(max(0.0, start + seconds / speed - time.monotonic()))
                self._take(seconds, what, files)
                progress.update(task, completed=files.taken, description=f"flying, {seconds:.0f} s")
        self._finish(progress)
        return self._done

    def summarise(self, done: list[Done], seconds: float) -> None:
        """Print the outcomes of the frames and events."""
        summarise(self._pipeline, done, seconds, self._console)
        tell(self._console, f"events: {_told(self._pipeline.accounts().events)}")

    def close(self) -> None:
        self._pipeline.close()

    def _take(self, now: float, what: CameraMessage | Notice | ComingFile, files: _ReadAhead) -> None:
        self._now = now
        self._event_log.tick(now)
        match what:
            case CameraMessage():
                self._event_log.message(what, now)
            case Notice():
                self._say(what)
            case ComingFile():
                self._take_file(files.next(), now, what.fresh)
        self._event_log.save()

    def _take_file(self, file: DecodedFrame | UndecodableFrame | DamagedFile, now: float, fresh: bool) -> None:
        if isinstance(file, DamagedFile):
            self._driver.accept(file)
            return
        found = replace(file.frame, received=now)
        frame = self._driver.accept(found)
        if frame is None:
            self._event_log.copy(found, now, of=self._pipeline.store.shown_by(found))
            return
        self._event_log.frame(found, now, fresh=fresh)
        self._done.append(self._driver.process(replace(file, frame=frame)))

    def _finish(self, progress: RunProgress) -> None:
        task = progress.add_task("final painting", total=None)
        for _ in self._driver.finish():
            progress.advance(task)
        self._event_log.close()
        self._event_log.save()
        self._pipeline.save()
        out, doubts = self._pipeline.store.out, self._event_log.doubts
        text = (
            doubts.text(typed(out)) if self._judges and doubts else contradiction_text(self._pipeline.store.ledger, out)
        )
        if text is not None:
            self._say(Notice(source="pairing", level="warning", text=text))

    def _say(self, notice: Notice) -> None:
        say(self._console, notice)


class _ReadAhead:
    """Files in order of arrival, read and prepared ahead."""

    def __init__(self, coming: Sequence[ComingFile], config: Config, preparation: Preparation) -> None:
        self.taken = 0
        self._coming, self._settings = iter(coming), config.frames
        self._prove = Proof(config.decode, config.frames.max_pixels)  # what is damaged takes no event, as in the flight
        self._read: deque[Frame | DamagedFile] = deque()
        self._preparation = preparation

    def next(self) -> DecodedFrame | UndecodableFrame | DamagedFile:
        """The next file; raises if there is none."""
        self._read_on()
        self.taken += 1
        found = self._read.popleft()
        if isinstance(found, DamagedFile):
            return found
        prepared = self._preparation.next()
        assert prepared is not None, "every frame that was read is being prepared"
        return prepared

    def close(self) -> None:
        self._preparation.close()
        self._prove.close()

    def _read_on(self) -> None:
        while len(self._read) <= AHEAD and (file := next(self._coming, None)) is not None:
            found = read_frame(file.look, file.look.name, self._settings, self._prove)
            if file.vehicle is not None:
                found = marked(found, file.vehicle)
            self._read.append(found)
            if isinstance(found, Frame):
                self._preparation.append(found)


def _told(account: EventAccount) -> str:
    counts = {state: getattr(account, state) for state in account.__slots__}
    return ", ".join(f"{count} {state}" for state, count in counts.items() if count) or "none"
