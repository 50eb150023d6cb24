"""Whether a flight can be resumed: its folder has a checkpoint, made with settings that give the same map."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.view_graph import Link
from gcs_mosaic.stitch.registration.registration import Registration
from gcs_mosaic.stitch.transaction import Snapshot
from gcs_mosaic.store.checkpoint import Checkpoints, Unusable
from gcs_mosaic.store.records import EventRecord, FrameRecord

SAME_CLOCK_S = 60.0  # a clock that was set right meanwhile, by less than any start of a machine takes
LARGE = (Features, Link, Registration)  # values of a checkpoint that are written once


def settings_of(config: Config) -> str:
    """What must be the same for a map to be gone on with: how frames are placed and painted."""
    return repr((config.method, config.scale, config.stitch, config.paint))


def saved_flight(checkpoints: Checkpoints, config: Config) -> Snapshot | Unusable:
    """What was saved of a flight, its `pipeline` being for `Pipeline.resume`, or why it cannot be resumed with these settings."""
    saved = checkpoints.load()
    if isinstance(saved, Unusable):
        return saved
    if not isinstance(saved, dict) or not isinstance(saved.get("pipeline"), dict):
        return Unusable("its checkpoint is none of ours")
    if saved.get("settings") != settings_of(config):
        return Unusable("it was flown with other settings (method, scale, stitch or paint)")
    return saved


def checkpoints_of(out: Path, config: Config) -> Checkpoints | None:
    """Those of a flight's folder; the paper's recipe has none, its one picture is in memory only."""
    return None if config.method == "paper" else Checkpoints(out, LARGE)


def files_taken(frames: Iterable[FrameRecord]) -> dict[str, Taken]:
    """The newest version of each file that a flight has taken, by the file's name."""
    taken: dict[str, Taken] = {}
    for frame in frames:
        if frame.content_hash is not None and frame.size is not None and frame.modified is not None:
            name, version = file_and_version(frame.name)
            if name not in taken or taken[name].version < version:
                taken[name] = Taken(version, frame.size, frame.modified)
    return taken


def told_again(
    events: Iterable[EventRecord], frames: Iterable[FrameRecord], later_s: float
) -> list[EventRecord | FrameRecord]:
    """All events and frames of a flight in the order in which they came, as if they had come `later_s` later."""
    told: list[EventRecord | FrameRecord] = []
    for record in events:
        told.append(replace(record, event=replace(record.event, received=record.event.received + later_s)))
    for frame in frames:
        if frame.received is not None:
            told.append(replace(frame, received=frame.received + later_s))
    return sorted(told, key=_came)


def _came(record: EventRecord | FrameRecord) -> float:
    return record.event.received if isinstance(record, EventRecord) else record.received or 0.0


def later_by(saved: Snapshot) -> float:
    """How far this run's monotonic clock is behind the one of the run that was saved, in seconds: times of that one must be
    moved by so much. They share it unless the machine was started anew."""
    apart = float(saved["utc_of_zero"]) - utc_of_zero()
    return apart if abs(apart) > SAME_CLOCK_S else 0.0


def utc_of_zero() -> float:
    """When the monotonic clock of this machine stood at 0, in seconds since 1970."""
    return time.time() - time.monotonic()
