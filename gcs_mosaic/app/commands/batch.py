"""`gcs-mosaic stitch`: a folder of frames, or recorded videos, through the same pipeline as a live flight, without MAVLink."""

from __future__ import annotations

import logging
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from gcs_mosaic.app.inputs.given import GivenFrames, given_frames
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.pipeline.resuming import OpenedFlight, begin_stitch, open_stitch
from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.app.status.run_progress import RunProgress
from gcs_mosaic.app.waiting.prefetch import Preparation, one_after_another
from gcs_mosaic.app.waiting.turns import prepared_at_once
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import NothingPlaced, UsageError
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.notes.anchors.anchor_setting import let_positions_lay
from gcs_mosaic.render.display import display_of
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.held_out import held_out_lines, largest, torn_lines
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.log import log_notice
from gcs_mosaic.store.status import frames_words

if TYPE_CHECKING:
    from gcs_mosaic.debug.pictures import DebugPictures

logger = logging.getLogger(__name__)

STAGES = ("decode", "features", "place", "paint", "write")


def stitch(
    sources: Sequence[Path],
    out: Path,
    config: Config,
    console: Console,
    debug: Path | None = None,
    *,
    resume: bool = False,
) -> Path:
    """Stitch images in the order of `frames_in`, and videos from beginning to end; returns the flight's folder. `debug`: folder
    for debug images; `resume`: go on with the newest flight in `out`.

    Raises UsageError before anything is written, and NothingPlaced at the end.
    """
    _refuse_map_among_frames(sources, out)  # before anything is written
    # As a flight whose frames come from these files: no live flight goes on with it by itself.
    its_own = replace(config, out=str(out), watch=", ".join(map(str, sources)), rtsp=None, sources=())
    with ExitStack() as stack:
        known, times, opened = dict[str, str](), dict[str, float | None](), None
        if resume:
            opened = stack.enter_context(closing(open_stitch(its_own)))
            known, times = _known(opened.folder.path)
        given = given_frames(sources, config, known, times)
        pictures = _debug_pictures(debug) if debug else None
        if opened is None:
            opened = stack.enter_context(closing(begin_stitch(its_own)))
        folder = opened.folder
        with flight_log(folder, config):
            say(console, Notice(source="out", level="info", text=folder.said))
            _introduce(given, console)
            with closing(_pipeline(opened, given, its_own, console, pictures)) as pipeline:
                _stitch_into(pipeline, given, opened, config, console)
                frames = pipeline.accounts().frames
                if pictures:
                    pictures.write(pipeline.mosaic.placements(), lambda name: _seen(pipeline, name))
                    tell(console, f"debug pictures: {debug}")
    if not frames.placed:
        count = frames_words(sum(_counts(frames).values()))
        raise NothingPlaced(f"none of {count} found a place: there is no map, {folder.path} has the reasons")
    return folder.path


def _known(flight: Path) -> tuple[dict[str, str], dict[str, float | None]]:
    """Content hashes and modification times of the frames that a flight has already, by name."""
    with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
        frames = ledger.frames()
    known = {frame.name: frame.content_hash for frame in frames if frame.content_hash is not None}
    return known, {frame.name: frame.modified for frame in frames}


def _pipeline(
    opened: OpenedFlight, given: GivenFrames, config: Config, console: Console, pictures: DebugPictures | None
) -> Pipeline:
    # A finished folder is no longer written to, so its frames need no copies.
    linking = replace(config, originals=replace(config.originals, keep="link"))
    # What takes hours is gone on with where it was; a folder of images is stitched again as quickly.
    lasts = bool(given.videos.readings) or opened.folder.resumed
    return Pipeline(
        opened.folder.path,
        linking,
        lambda notice: say(console, notice),
        punctual=True,
        paint_live=False,  # no live view here: all frames are painted once, at the end
        observer=pictures,
        checkpoints=opened.checkpoints if lasts else None,
        shelf=opened.shelf,
    )


def _refuse_map_among_frames(sources: Sequence[Path], out: Path) -> None:
    """Raises UsageError if the map would be written among the frames."""
    if any(source.is_dir() and source.resolve() == out.resolve() for source in sources):
        raise UsageError(
            f"--out {out} is the folder of the frames: choose another one, or the map would lie among them"
        )


def _introduce(given: GivenFrames, console: Console) -> None:
    say(console, Notice(source="frames", level="info", text=given.order))
    for text in given.passed_over:
        say(console, Notice(source="frames", level="warning", text=text))
    for text in given.notes:
        logger.info("%s", text)


def _seen(pipeline: Pipeline, name: str) -> NDArray[np.uint8] | None:
    """A frame (h, w, 3) at full size for display, with its own contrast stretch."""
    image = pipeline.load_original(name, reduction=1)
    return None if image is None else display_of(image).picture(image)


def _debug_pictures(folder: Path) -> DebugPictures:
    from gcs_mosaic.debug.pictures import DebugPictures

    return DebugPictures(folder)


def _stitch_into(
    pipeline: Pipeline, given: GivenFrames, opened: OpenedFlight, config: Config, console: Console
) -> None:
    start = time.monotonic()
    if config.anchor == "positions":
        say(console, let_positions_lay(opened.folder.path))
    preparation, driver = prefetching(pipeline, config), Driver(pipeline)
    again = _gone_on_with(pipeline, opened) if opened.folder.resumed else []
    with closing(preparation), RunProgress(console) as progress, progress.kept_in(opened.folder.path, "stitch"):
        task, done = progress.add_task("stitching", total=given.steps), list[Done]()
        for decoded in one_after_another(preparation, chain(again, _accepted(driver, given, console))):
            done.append(driver.process(decoded))
            pipeline.checkpoint()
            steps = given.steps_done(pipeline.store.taken_in - len(preparation))
            progress.update(task, completed=steps, description=f"stitching {done[-1].name}")
        final = progress.add_task("final painting", total=None)
        for _ in driver.finish():
            progress.advance(final)
    pipeline.checkpoint(at_once=True)
    summarise(pipeline, done, time.monotonic() - start, console)


def _gone_on_with(pipeline: Pipeline, opened: OpenedFlight) -> list[Frame]:
    """The frames of an earlier run that are still to be placed."""
    again = pipeline.resume(opened.saved)
    pipeline.save()
    return again


def _accepted(driver: Driver, given: GivenFrames, console: Console) -> Iterator[Frame]:
    """New frames, as kept."""
    for item in given.items():
        if isinstance(item, Notice):
            say(console, item)
        elif (frame := driver.accept(item)) is not None:
            yield frame


def prefetching(pipeline: Pipeline, config: Config) -> Preparation:
    """Sequential look-ahead decoding for a pipeline. To find features takes 165 MB, and OpenCV does it on two cores at a time."""
    at_once = prepared_at_once(os.cpu_count() or 1)
    given = pipeline.features_of, pipeline.decoders, config.reduction, pipeline.feature_pixels
    return Preparation(*given, at_once=at_once)


def summarise(pipeline: Pipeline, done: list[Done], seconds: float, console: Console) -> None:
    """Print a one-screen summary: frame outcomes and time by stage."""
    for line in _summary(pipeline, seconds):
        tell(console, line)
    table = Table("stage", "median s", "longest s", "total s", title="time per frame")
    for stage, median, longest, total in _times(done):
        logger.info("%s: median %s s, longest %s s, total %s s", stage, median, longest, total, extra={"said": True})
        table.add_row(stage, median, longest, total)
    console.print(table)


def _summary(pipeline: Pipeline, seconds: float) -> Iterator[str]:
    counts = _counts(pipeline.accounts().frames)
    yield f"{counts['placed']} of {sum(counts.values())} frames placed in {seconds:.1f} s, {pipeline.store.out}"
    yield from (f"  {count} {state}" for state, count in counts.items() if count and state != "placed")
    reasons = Counter(frame.reason for frame in pipeline.store.ledger.frames() if frame.reason)
    yield from (f"    {count} x {reason}" for reason, count in reasons.most_common(8))
    yield _islands_in_words(sorted(pipeline.mosaic.frame_counts().items(), key=lambda item: -item[1]))
    held_out = pipeline.mosaic.held_out()
    yield from held_out_lines(largest(held_out, 12))
    yield from (f"warning: {text}" for text in torn_lines(held_out))


def _islands_in_words(islands: Sequence[tuple[int, int]]) -> str:
    """Islands given as (number, frame count), largest first."""
    if len(islands) == 1:
        return f"one island, {frames_words(islands[0][1])}"
    sizes = ", ".join(f"number {number} with {frames_words(count)}" for number, count in islands[:12])
    return f"{len(islands)} islands: {sizes}{', ...' if len(islands) > 12 else ''}" if islands else "no island"


def _counts(account: object) -> dict[str, int]:
    return {state: getattr(account, state) for state in account.__slots__}  # type: ignore[attr-defined]


def _times(done: list[Done]) -> Iterator[tuple[str, ...]]:
    """Seconds per frame of each stage: median, maximum and total."""
    for stage in STAGES:
        seconds = sorted(d.seconds[stage] for d in done if stage in d.seconds)
        if seconds:
            yield stage, f"{seconds[len(seconds) // 2]:.3f}", f"{seconds[-1]:.3f}", f"{sum(seconds):.1f}"


def tell(console: Console, text: str) -> None:
    """Print a line for the operator and log it; it may quote file names and error messages."""
    logger.info("%s", text, extra={"said": True})
    console.print(text, markup=False)


def say(console: Console, notice: Notice) -> None:
    """Show a notice to the operator."""
    log_notice(logger, notice)
    text = f"{notice.level}: {notice.text}" if notice.level != "info" else notice.text
    console.print(text, markup=False)  # it may quote file names
