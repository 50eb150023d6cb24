"""The frame sources of a live flight: one, or one for each of several aircraft."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.app.inputs.extended_source import extension_frames, known_frames
from gcs_mosaic.app.inputs.inbox import attach_stream, initial_report, watching
from gcs_mosaic.app.inputs.links import ItemSource
from gcs_mosaic.app.pipeline.resuming import files_taken
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.aircraft_source import name_without, of_aircraft
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.frames.video.reading import known_by_video
from gcs_mosaic.frames.video.watched import Room
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.messages import SourceReport
from gcs_mosaic.store.folder import LEDGER_NAME, FlightFolder, refuse_watching_ourselves
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameRecord


@dataclass(frozen=True, slots=True)
class FrameSource:
    """One source; `config` has it as its only one. `vehicle`: whose it is, None if it is that of all."""

    config: Config
    vehicle: int | None = None

    @property
    def watched(self) -> Path | None:
        """Its folder; None for a stream."""
        return None if self.config.rtsp else Path(self.config.watch)

    @property
    def report(self) -> SourceReport:
        """Its state before its first report."""
        return replace(initial_report(self.config), vehicle=self.vehicle)

    def marked(self, source: ItemSource) -> ItemSource:
        """The same items, told to be this aircraft's."""
        if self.vehicle is None:
            return source
        return ItemSource(of_aircraft(source.items, self.vehicle), self.report_of_failure())

    def report_of_failure(self) -> SourceReport:
        return replace(self.report, state="ended")


def frame_sources(config: Config) -> list[FrameSource]:
    """The sources that the settings name. Raises UsageError if two of them are one folder or one stream."""
    if not config.sources:
        return [FrameSource(config)]
    sources = [FrameSource(config.of_source(one), one.vehicle) for one in config.sources]
    folders = {one.vehicle: one.watched.resolve() for one in sources if one.watched}
    for vehicle, folder in folders.items():
        for other, inside in folders.items():
            if other != vehicle and inside.is_relative_to(folder):
                text = f"the frames of aircraft {other} come into {inside}, which is watched for aircraft {vehicle} too"
                raise UsageError(f"{text}: give each a folder of its own, none inside another")
    return sources


def refuse_our_own(sources: Iterable[FrameSource], out: Path) -> None:
    """Raises UsageError if pictures that we write would become frames."""
    for source in sources:
        if source.watched is not None:
            refuse_watching_ourselves(source.watched, out)


def with_streams(
    links: Sequence[ItemSource], sources: Iterable[FrameSource], trust: Trust, stop: threading.Event
) -> list[ItemSource]:
    """The links, whose shots (`Shots.follow`) ask the live streams for pictures, and these streams. Raises UsageError."""
    inputs = list(links)
    for source in sources:
        if source.config.rtsp:
            *asking, stream = attach_stream(source.config.rtsp, inputs, source.config, stop, trust, source.vehicle)
            inputs = [*asking, source.marked(stream)]
    return inputs


def watched_folders(
    sources: Iterable[FrameSource], folder: FlightFolder, stop: threading.Event, room: Room | None = None
) -> Iterator[ItemSource]:
    """The watched folders, created if missing, and an extension's source; `room`: for frames of videos. Raises UsageError."""
    sources = list(sources)
    for source in sources:
        if not source.config.rtsp:
            taken, known = taken_of(folder, source.vehicle), videos_taken_of(folder, source.vehicle)
            yield source.marked(watching(source.config, stop, taken, known, room))
    first = sources[0]
    if first.config.source is not None:
        frames = extension_frames(first.config.source, known_frames(folder), stop)
        yield ItemSource(frames, first.report_of_failure())


def elsewhere(sources: Iterable[FrameSource], name: str) -> Path:
    """Where the file of a frame was found, by the frame's name."""
    file, _ = file_and_version(name)
    for source in sources:
        within = name_without(source.vehicle, file)
        if source.vehicle is None or within != file:
            return Path(source.config.watch) / within
    return Path(file)


def taken_of(folder: FlightFolder, vehicle: int | None) -> dict[str, Taken] | None:
    """Files of one source that were accepted already; None for a new flight."""
    if not folder.resumed:
        return None
    with Ledger(folder.path / LEDGER_NAME, read_only=True) as ledger:
        return files_taken(_within(ledger.frames(), vehicle))


def videos_taken_of(folder: FlightFolder, vehicle: int | None) -> dict[str, dict[str, str]]:
    """Frames of one source's videos that were accepted already: their content hashes by name, by video."""
    if not folder.resumed:
        return {}
    with Ledger(folder.path / LEDGER_NAME, read_only=True) as ledger:
        frames = _within(ledger.frames(), vehicle)
        return known_by_video((one.name, one.content_hash) for one in frames if one.content_hash is not None)


def _within(frames: Iterable[FrameRecord], vehicle: int | None) -> Iterator[FrameRecord]:
    """By their names, for it is names that must not come twice: a flight may have been begun with its sources told otherwise."""
    for frame in frames:
        within = name_without(vehicle, frame.name)
        if vehicle is None or within != frame.name:
            yield replace(frame, name=within)
