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

SAME_CLOCK_S = 60.0  # tolerance for clock corrections, shorter than any reboot takes
LARGE = (Features, Link, Registration)  # types of checkpoint values that are written once


def settings_of(config: Config) -> str:
    """The settings that must match to resume a map: how frames are placed and painted."""
    return repr((config.method, config.scale, config.stitch, config.paint))


def saved_flight(checkpoints: Checkpoints, config: Config) -> Snapshot | Unusable:
    """A flight's saved state, its `pipeline` being for `Pipeline.resume`, or why it cannot be resumed with these settings."""
    saved = checkpoints.load()
    if isinstance(saved, Unusable):
        return saved
    if not isinstance(saved, dict) or not isinstance(saved.get("pipeline"), dict):
        return Unusable("its checkpoint is none of ours")
    if saved.get("settings") != settings_of(config):
        return Unusable("it was flown with other settings (method, scale, stitch or paint)")
    return saved


def checkpoints_of(out: Path, config: Config) -> Checkpoints | None:
    """The checkpoints of a flight's folder; None for the paper's recipe, whose single image exists in memory only."""
    return None if config.method == "paper" else Checkpoints(out, LARGE)


def files_taken(frames: Iterable[FrameRecord]) -> dict[str, Taken]:
    """The newest version of each file accepted by a flight, by file name."""
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
    """All events and frames of a flight in order of arrival, with times shifted by `later_s`."""
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
    """Offset in seconds from the saved run's monotonic clock to this run's, to be added to the saved run's times. 0 unless the
    machine was rebooted."""
    apart = float(saved["utc_of_zero"]) - utc_of_zero()
    return apart if abs(apart) > SAME_CLOCK_S else 0.0


def utc_of_zero() -> float:
    """UTC at which this machine's monotonic clock read 0, in seconds since 1970."""
    return time.time() - time.monotonic()
