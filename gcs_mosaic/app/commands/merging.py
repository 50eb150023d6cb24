"""`gcs-mosaic merge`: flights of earlier days or of other laptops become one map, by their pictures alone.

What each flight has found (features, matches, poses, lenses) is taken from its checkpoint; a flight without one that fits is
stitched again from its originals. Then the islands of all are compared as in the pauses of a flight.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from gcs_mosaic.app.commands.batch import prefetching, say, summarise
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of, saved_flight, shelf_of
from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.app.status.run_progress import RunProgress
from gcs_mosaic.app.waiting.prefetch import one_after_another
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import NothingPlaced, UsageError
from gcs_mosaic.messages import DamagedFile, Frame, Notice
from gcs_mosaic.notes.merged_notes import NotedFlight, merge_notes
from gcs_mosaic.stitch.graph.union import Renamed
from gcs_mosaic.store.array_shelf import ArrayShelf
from gcs_mosaic.store.checkpoint import Unusable
from gcs_mosaic.store.flight_store import FlightStore, frame_of
from gcs_mosaic.store.folder import LEDGER_NAME, find_flight, open_flight_folder, refuse_strange_parts
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.records import EventState, FrameRecord, FrameState

logger = logging.getLogger(__name__)

OF_ONE_FLIGHT = 1000  # more than there are MAVLink system ids
DECIDED = (FrameState.REJECTED, FrameState.DUPLICATE, FrameState.DAMAGED, FrameState.DROPPED)


@dataclass(frozen=True, slots=True)
class MergedFlight:
    """One of the flights; `label` is put before the names of its frames, `number` tells its cameras from those of others."""

    path: Path
    label: str
    number: int

    def name_of(self, name: str) -> str:
        return f"{self.label}/{name}"

    def aircraft_of(self, aircraft: int | None) -> int:
        """No camera is taken for one of another flight: on another day it may have another lens."""
        return self.number * OF_ONE_FLIGHT + (aircraft or 0)


def merge(flights: Sequence[Path], out: Path, config: Config, console: Console) -> Path:
    """Join finished flights into one map in `out`, a new folder; returns it.

    Raises UsageError before anything is written, and NothingPlaced at the end.
    """
    sources = sources_of(flights, out)
    with ExitStack() as stack:
        for source in sources:
            _hold(source.path, stack)
        folder = open_flight_folder(out)
        stack.enter_context(closing(folder))
        stack.enter_context(flight_log(folder, config))
        say(console, Notice(source="out", level="info", text=folder.said))
        if not _merge_into(folder.path, sources, config, console):
            text = f"no frame of these flights found a place: there is no map, {folder.path} has the reasons"
            raise NothingPlaced(text)
        for notice in merge_notes(folder.path, [NotedFlight(source.path, source.name_of) for source in sources]):
            say(console, notice)
    return folder.path


def sources_of(flights: Sequence[Path], out: Path) -> list[MergedFlight]:
    """The flights, each with a name of its own. Raises UsageError for what cannot be merged."""
    if len(flights) < 2:
        named = flights[0] if flights else "none"
        raise UsageError(
            f"merge joins two flights or more, {named} alone was given: name the folders of the others, too"
        )
    for k, path in enumerate(flights):
        find_flight(path)
        refuse_strange_parts(path)
        with Ledger(path / LEDGER_NAME, read_only=True):
            pass  # of a version that is known
        if path.resolve() in [other.resolve() for other in flights[:k]]:
            raise UsageError(f"{path} was given twice: name each flight once")
        if out.resolve().is_relative_to(path.resolve()):
            raise UsageError(
                f"--out {out} lies in the flight {path}, which is left as it is: choose a folder elsewhere"
            )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"--out {out} is not an empty folder: name a new one for the merged map")
    return [
        MergedFlight(path, label, k) for k, (path, label) in enumerate(zip(flights, _labels(flights), strict=True), 1)
    ]


def _labels(flights: Sequence[Path]) -> list[str]:
    """The folders' names; a number is added where two are alike."""
    labels: list[str] = []
    for path in flights:
        name, number = path.resolve().name, 1
        while (label := name if number == 1 else f"{name}-{number}") in labels:
            number += 1
        labels.append(label)
    return labels


def _hold(flight: Path, stack: ExitStack) -> None:
    """Keep others from writing into a flight meanwhile. Raises UsageError if somebody does."""
    try:
        lock = try_lock(flight)
    except OSError:  # where nobody can write, nobody does
        return
    if lock is None:
        raise UsageError(f"{flight} is being written by another gcs-mosaic: end that flight first")
    stack.callback(lock.release)


def _merge_into(out: Path, sources: Sequence[MergedFlight], config: Config, console: Console) -> int:
    """Returns the number of frames that were placed."""
    start, carried = time.monotonic(), dict[str, int]()
    linking = replace(config, originals=replace(config.originals, keep="link"))  # nobody writes into those any more

    def told(notice: Notice) -> None:
        say(console, notice)

    shelf = shelf_of(config, out)
    pipeline = Pipeline(
        out,
        linking,
        told,
        punctual=True,
        paint_live=False,
        shelf=shelf,
        camera_of=lambda frame: carried[frame.name],
    )
    with closing(pipeline):
        for source in sources:
            carried |= _take_in(pipeline.store, source)
            said = _take_over(pipeline, source, config, shelf)
            told(Notice(source="merge", level="info", text=said))
        again = pipeline.resume(None)
        pipeline.save()
        done = _work_off(pipeline, again, config, console)
        summarise(pipeline, done, time.monotonic() - start, console)
        return pipeline.accounts().frames.placed


def _take_in(store: FlightStore, source: MergedFlight) -> dict[str, int]:
    """The rows and originals of a flight; returns whose camera took each frame, by its new name."""
    carried: dict[str, int] = {}
    with Ledger(source.path / LEDGER_NAME, read_only=True) as ledger, store.ledger.transaction():
        for record in ledger.frames():
            _take_frame(store, source, record)
            carried[source.name_of(record.name)] = source.aircraft_of(record.vehicle)
        _take_events(ledger, store.ledger, source)
        for name, recorded in ledger.recorded():
            store.ledger.record_position(source.name_of(name), recorded)
    return carried


def _take_frame(store: FlightStore, source: MergedFlight, record: FrameRecord) -> None:
    name = source.name_of(record.name)
    if record.content_hash is None:
        store.ledger.record_damaged(DamagedFile(name=name, reason=record.reason or "", vehicle=record.vehicle))
        return
    frame = replace(frame_of(record, source.path), name=name)
    decided = record.state in DECIDED
    store.adopt(frame, record.state, (record.reason or "") if decided else None)
    if record.width is not None and record.height is not None:
        store.ledger.record_size(name, record.width, record.height, record.sharpness)


def _take_events(ledger: Ledger, merged: Ledger, source: MergedFlight) -> None:
    """In their order, so that a duplicate comes after the event that it repeats."""
    numbers: dict[int, int] = {}
    for record in ledger.events():
        numbers[record.id] = merged.record_event(record.event)
        frame = None if record.frame is None else source.name_of(record.frame)
        of = None if record.duplicate_of is None else numbers[record.duplicate_of]
        # No frame comes any more for one of a flight that was not ended.
        state = EventState.MISSING if record.state is EventState.PENDING else record.state
        merged.settle_event(numbers[record.id], state, frame=frame, duplicate_of=of)


def _take_over(pipeline: Pipeline, source: MergedFlight, config: Config, shelf: ArrayShelf) -> str:
    """What a flight has found, if its checkpoint has it; returns what was done, for the operator."""
    again = f"{source.path}: its frames are stitched again, because"
    checkpoints = checkpoints_of(source.path, config, shelf, read_only=True)
    saved = saved_flight(checkpoints, config)
    if checkpoints is not None:
        checkpoints.close()
    if isinstance(saved, Unusable):
        return f"{again} {saved.reason}"
    try:
        pipeline.take_over(saved["pipeline"], Renamed(source.name_of, source.aircraft_of))
    except Exception as error:
        logger.exception("the checkpoint of %s could not be taken up", source.path)
        return f"{again} its checkpoint does not fit ({error!r})"
    return f"{source.path}: what it has found is taken over"


def _work_off(pipeline: Pipeline, again: Sequence[Frame], config: Config, console: Console) -> list[Done]:
    """Place what is to be placed again, join what overlaps, and paint all."""
    driver, done, out = Driver(pipeline), list[Done](), pipeline.store.out
    with (
        closing(prefetching(pipeline, config)) as preparation,
        RunProgress(console) as progress,
        progress.kept_in(out, "merge"),
    ):
        task = progress.add_task("stitching", total=len(again))
        for decoded in one_after_another(preparation, iter(again)):
            done.append(driver.process(decoded))
            progress.update(task, completed=len(done), description=f"stitching {done[-1].name}")
        final = progress.add_task("joining and painting", total=None)
        for _ in _finish(pipeline):
            progress.advance(final)
    return done


def _finish(pipeline: Pipeline) -> Iterator[None]:
    """Join the islands, link them more, paint all; step by step, saving after each."""
    for _ in pipeline.settle():
        pipeline.save()
        yield
    pipeline.link_across()
    for _ in pipeline.repaint_all():
        pipeline.save()
        yield
    pipeline.save()
