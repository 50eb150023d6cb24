"""Which flight a start goes on with, and from where: the newest in the folder, if its checkpoint was made with settings that
give the same map."""

from __future__ import annotations

import logging
import time
from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.render.brightness import Thumbnail
from gcs_mosaic.render.exposure import OverlapMeans
from gcs_mosaic.render.render_list import RenderEntry
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.view_graph import Link
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.transaction import Snapshot
from gcs_mosaic.store.array_shelf import ArrayShelf
from gcs_mosaic.store.checkpoint import NAME as CHECKPOINT_NAME
from gcs_mosaic.store.checkpoint import Checkpoints, Unusable
from gcs_mosaic.store.folder import (
    BeingWritten,
    FlightFolder,
    flights_of,
    lock_flight,
    open_flight_folder,
    resume_flight_folder,
    written_ns,
)
from gcs_mosaic.store.reading import read_document
from gcs_mosaic.store.records import EventRecord, FrameRecord
from gcs_mosaic.store.schema import DamagedLedger
from gcs_mosaic.store.status import STATUS_NAME
from gcs_mosaic.store.typed import typed

logger = logging.getLogger(__name__)

SAME_CLOCK_S = 60.0  # tolerance for clock corrections, shorter than any reboot takes
PAPER = Unusable("a map of the paper's recipe is in memory only")
# Types of checkpoint values that are written once.
LARGE = (Features, Link, Registration, RenderEntry, OverlapMeans, Thumbnail)


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenedFlight:
    """The folder of a flight, locked; `folder.resumed` if it is resumed.

    `saved`: where to go on from, None for a new flight and for one that is to be stitched again from its originals;
    `shelf`: where its features are.
    """

    folder: FlightFolder
    checkpoints: Checkpoints | None
    shelf: ArrayShelf
    saved: Snapshot | None = None

    def close(self) -> None:
        if self.checkpoints is not None:
            self.checkpoints.close()
        self.shelf.close()
        self.folder.close()


def open_flight(config: Config) -> OpenedFlight:
    """The flight to resume, or a new one, as `config.resume` asks. Raises UsageError."""
    out, refused = Path(config.out), ""
    if config.resume == "always":
        return _resumed(_asked_for(out, otherwise="--new"), config)
    recent = flights_of(out, time.time() - 3600 * config.resume_h) if config.resume == "auto" else []
    for path in recent:
        if not (path / CHECKPOINT_NAME).is_file():  # a stitched folder of frames, or a replay
            continue
        try:
            return _resumed(lock_flight(path), config, by_itself=True)
        except DamagedLedger as reason:
            logger.info("not resumed: %s", reason)
            refused = refused or _damaged(path)
        except BeingWritten as reason:
            logger.info("not resumed: %s", reason)
            refused = refused or f"{path} is being written by another gcs-mosaic{_mapped_again(path, config)}"
        except UsageError as reason:
            logger.info("not resumed: %s", reason)
            refused = refused or str(reason)
    opened = _begun(config)
    refused = refused or (_too_old(out, config.resume_h) if config.resume == "auto" else "")
    said = f"{refused}; this flight is written to {opened.folder.path}" if refused else opened.folder.said
    return replace(opened, folder=replace(opened.folder, said=said))


def _too_old(out: Path, resume_h: float) -> str:
    """What to say of the newest live flight there, none being recent; empty if there is none. Its age is by clocks that may be
    wrong, so whoever starts decides."""
    live = next((path for path in flights_of(out) if (path / CHECKPOINT_NAME).is_file()), None)
    if live is None:
        return ""
    written = time.strftime("%Y-%m-%d %H:%M", time.localtime(written_ns(live) / 1e9))
    return (
        f"{live} holds an earlier flight, last written {written}, over {resume_h:g} h ago: it is left as it is, and "
        "--resume goes on with it"
    )


def open_stitch(config: Config) -> OpenedFlight:
    """The newest flight of `out`, to be gone on with by `stitch`: what it has found so far is taken if it can be, else its frames
    are stitched again. Raises UsageError."""
    folder = _asked_for(Path(config.out), otherwise="another --out")
    opened = _opened(folder, config)
    saved = saved_flight(opened.checkpoints, config)
    if not isinstance(saved, Unusable):
        return replace(opened, saved=saved)
    said = f"{folder.said}; {saved.reason}, so its frames are stitched again"
    return replace(opened, folder=replace(folder, said=said))


def _asked_for(out: Path, *, otherwise: str) -> FlightFolder:
    """The newest flight of `out`, locked. `otherwise`: what begins another one. Raises UsageError."""
    try:
        return resume_flight_folder(out)
    except DamagedLedger as reason:
        logger.info("not resumed: %s", reason)
        text = f"--resume: {_damaged(flights_of(out)[0])}, or begin another flight with {otherwise}"
        raise UsageError(text) from reason
    except BeingWritten as reason:
        raise UsageError(f"--resume: {reason}") from reason


def _damaged(path: Path) -> str:
    how = f"gcs-mosaic check {typed(path)} --repair may bring it back"
    return f"the ledger of the flight in {path} is damaged, and left as it is: {how}"


def _mapped_again(path: Path, config: Config) -> str:
    """What to say if the program that writes the flight there watches the same folder; empty if not, or if that is not known."""
    if config.rtsp or config.sources or config.source is not None:
        return ""
    try:
        watched = read_document(path / STATUS_NAME)["watch"]["folder"]
        same = Path(watched).resolve() == Path(config.watch).resolve()
    except (OSError, ValueError, LookupError, TypeError):
        logger.debug("what is watched for %s is not known", path, exc_info=True)
        return ""
    return (
        f", so {config.watch} is mapped a second time (gcs-mosaic serve {typed(path)} shows that map, too)"
        if same
        else ""
    )


def begin_stitch(config: Config) -> OpenedFlight:
    """A new flight. Raises UsageError."""
    return _begun(config)


def _begun(config: Config) -> OpenedFlight:
    return _opened(open_flight_folder(Path(config.out)), config)


def _opened(folder: FlightFolder, config: Config) -> OpenedFlight:
    shelf = shelf_of(config, folder.path)
    return OpenedFlight(folder=folder, checkpoints=checkpoints_of(folder.path, config, shelf), shelf=shelf)


def _resumed(folder: FlightFolder, config: Config, *, by_itself: bool = False) -> OpenedFlight:
    """Raises UsageError, the folder being closed, if its flight cannot be resumed."""
    opened = _opened(folder, config)
    saved = saved_flight(opened.checkpoints, config, same_source=by_itself)
    if not isinstance(saved, Unusable):
        return replace(opened, saved=saved)
    if saved.stitch_again:
        said = f"{folder.said}; {saved.reason}, so its frames are stitched again"
        return replace(opened, folder=replace(folder, said=said))
    opened.close()
    if by_itself:
        raise UsageError(f"the flight in {folder.path} is left as it is: {saved.reason}")
    raise UsageError(
        f"--resume: the flight in {folder.path} cannot be gone on with: {saved.reason}. Start without --resume: the new "
        f"flight is written beside it, and gcs-mosaic stitch {typed(folder.path / 'frames')} makes a map of what it has."
    )


def settings_of(config: Config) -> str:
    """The settings that must match to resume a map: how frames are placed and painted, on however large a machine."""
    canvas = replace(config.paint.canvas, memory_mb=0, threads=0)
    placing, painting = replace(config.stitch, memory_mb=0), replace(config.paint, canvas=canvas)
    return repr((config.method, config.scale, placing, painting))


def source_of(config: Config) -> str:
    """Where frames come from: a flight resumes by itself only with frames of the same camera."""
    if not config.sources:
        return config.rtsp or str(Path(config.watch).resolve())
    in_order = sorted(config.sources, key=lambda one: one.vehicle)
    return ", ".join(f"{one.vehicle}={source_of(config.of_source(one))}" for one in in_order)


def saved_flight(checkpoints: Checkpoints | None, config: Config, *, same_source: bool = False) -> Snapshot | Unusable:
    """A flight's saved state, its `pipeline` being for `Pipeline.resume`, or why it cannot be resumed with these settings."""
    saved = PAPER if checkpoints is None else checkpoints.load()
    if isinstance(saved, Unusable):
        return saved
    if not isinstance(saved, dict) or not isinstance(saved.get("pipeline"), dict):
        return Unusable("its checkpoint is none of ours", stitch_again=True)
    if saved.get("settings") != settings_of(config):
        return Unusable("it was flown with other settings (method, scale, stitch or paint)")
    if same_source and saved.get("source") != source_of(config):
        return Unusable(f"its frames came from {saved.get('source')}")
    return saved


def shelf_of(config: Config, out: Path) -> ArrayShelf:
    """Where the features of a flight are; `out`: its folder."""
    return ArrayShelf(config.stitch.memory_mb << 20, out)


def checkpoints_of(
    out: Path, config: Config, shelf: ArrayShelf | None = None, *, read_only: bool = False
) -> Checkpoints | None:
    """The checkpoints of a flight's folder; None for the paper's recipe, whose single image exists in memory only.

    `shelf`: where the features and thumbnails go that are read.
    """

    def received(value: object) -> object:
        return value.shelved(shelf.shelve) if isinstance(value, Features | Thumbnail) and shelf is not None else value

    return None if config.method == "paper" else Checkpoints(out, LARGE, received, read_only=read_only)


def files_taken(frames: Iterable[FrameRecord]) -> dict[str, Taken]:
    """The newest version of each file accepted by a flight, by file name."""
    taken: dict[str, Taken] = {}
    for frame in frames:
        if frame.content_hash is not None and frame.size is not None and frame.modified is not None:
            name, version = file_and_version(frame.name)
            if name not in taken or taken[name].version < version:
                taken[name] = Taken(version, frame.size, frame.modified)
    return taken


@dataclass(frozen=True, slots=True)
class Run:
    """One run of the program in a flight: how many events and frames were in the ledger when it began, and its clock's zero."""

    events: int
    frames: int
    utc_of_zero: float  # UTC at which its monotonic clock read 0
    boot: str = ""  # of the machine, since which that clock has gone on; empty if not known


def runs_of(saved: Snapshot | None) -> list[Run]:
    """All runs of a flight so far; empty if that is not known."""
    runs = saved.get("runs") if saved else None
    return [run for run in runs if isinstance(run, Run)] if isinstance(runs, list) else []


def told_again(
    events: Sequence[EventRecord], frames: Sequence[FrameRecord], runs: Sequence[Run]
) -> list[EventRecord | FrameRecord]:
    """All events and frames of a flight in order of arrival, their times on this run's monotonic clock."""
    told: list[EventRecord | FrameRecord] = []
    for record, later_s in zip(events, _later([run.events for run in runs], runs, len(events)), strict=True):
        told.append(replace(record, event=replace(record.event, received=record.event.received + later_s)))
    for frame, later_s in zip(frames, _later([run.frames for run in runs], runs, len(frames)), strict=True):
        if frame.received is not None:
            told.append(replace(frame, received=frame.received + later_s))
    told.sort(key=_came)
    ahead_s = _came(told[-1]) - time.monotonic() if told else 0.0
    return told if ahead_s <= 0 else [_earlier(record, ahead_s) for record in told]  # of a clock that nobody knows


def _later(began: Sequence[int], runs: Sequence[Run], count: int) -> Iterator[float]:
    """For each of `count` records the offset from the clock of its run to this run's. 0 unless the machine was rebooted."""
    boot, zero = boot_id(), utc_of_zero()
    offsets = [0.0 if _is_of_this_boot(run, boot, zero) else run.utc_of_zero - zero for run in runs]
    for k in range(count):
        yield offsets[max(bisect(began, k) - 1, 0)] if offsets else 0.0


def _is_of_this_boot(run: Run, boot: str, zero: float) -> bool:
    if run.boot and boot:
        return run.boot == boot  # however UTC has been set meanwhile
    return abs(run.utc_of_zero - zero) <= SAME_CLOCK_S


def _came(record: EventRecord | FrameRecord) -> float:
    return record.event.received if isinstance(record, EventRecord) else record.received or 0.0


def _earlier(record: EventRecord | FrameRecord, seconds: float) -> EventRecord | FrameRecord:
    if isinstance(record, EventRecord):
        return replace(record, event=replace(record.event, received=record.event.received - seconds))
    return replace(record, received=_came(record) - seconds)


def utc_of_zero() -> float:
    """UTC at which this machine's monotonic clock read 0, in seconds since 1970."""
    return time.time() - time.monotonic()


def boot_id() -> str:
    """Which start of this machine it is, as Linux tells; empty elsewhere."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
    except (OSError, ValueError):
        return ""
