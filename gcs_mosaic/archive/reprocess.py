"""`gcs-mosaic reprocess`: from an archive of frames to a map, stage by stage."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.archive.adjustment import adjusted_islands
from gcs_mosaic.archive.arrivals import arrivals_of
from gcs_mosaic.archive.artefacts import Lost
from gcs_mosaic.archive.blend_maps import looked_at
from gcs_mosaic.archive.cluster import workers_at
from gcs_mosaic.archive.engine import AGAIN, Engine
from gcs_mosaic.archive.exposure_compensation import compensated
from gcs_mosaic.archive.features import features_of
from gcs_mosaic.archive.files import is_bucket
from gcs_mosaic.archive.fixed_patterns import without_pattern
from gcs_mosaic.archive.frame_kinds import kinds_of
from gcs_mosaic.archive.islands import assembled, numbered_frames
from gcs_mosaic.archive.packing import Outcome, Reprocessed, beside, move_into_place, packed, upload
from gcs_mosaic.archive.painting import painted_map
from gcs_mosaic.archive.pairs import registered
from gcs_mosaic.archive.progress import Progress
from gcs_mosaic.archive.ranges import with_ranges
from gcs_mosaic.archive.relief import with_relief
from gcs_mosaic.archive.retrieval import pairs_of
from gcs_mosaic.archive.sources import Sources, sources_of
from gcs_mosaic.archive.stretches import STRETCH
from gcs_mosaic.archive.super_tiles import SIDE
from gcs_mosaic.archive.target import checked_target, refuse_source_in_target
from gcs_mosaic.archive.tasks import Passing
from gcs_mosaic.archive.tearing import measured
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import FlightFailed, NothingPlaced
from gcs_mosaic.frames.scan import shown_name
from gcs_mosaic.store.folder import ARTEFACTS
from gcs_mosaic.store.held_out import held_out_lines, largest, torn_lines
from gcs_mosaic.store.records import FrameState

ISLANDS_TOLD = 12
MOST_REASONS = 8  # told for each state


@dataclass(frozen=True, slots=True)
class Request:
    """What to make of what, and by whom. `cluster`: a scheduler's address, None for this machine, with `workers` or one a core;
    `stretch`: frames placed by one task; `side`: tiles along a super-tile."""

    sources: tuple[str, ...]
    target: str
    cluster: str | None = None
    workers: int | None = None
    dashboard: bool = False
    stretch: int = STRETCH
    side: int = SIDE


def reprocess(request: Request, config: Config, progress: Progress) -> None:
    """Make the flight. What was made before is not made again.

    Raises UsageError and CannotWrite for what was given, FlightFailed if it cannot go on, NothingPlaced if there is no map.
    """
    refuse_source_in_target(request.sources, request.target)
    sources = sources_of(request.sources, config.frames.cameras)
    with checked_target(request.target) as target:
        for text in sources.said:
            progress.say(text)
        kept = nullcontext() if is_bucket(target) else progress.kept_in(Path(target))
        with kept, workers_at(request.cluster, request.workers, dashboard=request.dashboard) as client:
            if request.dashboard:
                progress.say(f"what the workers do: {client.dashboard_link}")
            engine = Engine(client, f"{target}/{ARTEFACTS}", progress)
            try:
                found = reprocessed(engine, sources, config, request)
                outcomes = _pack(engine, found, target, config)
            except Lost as error:  # what the client itself reads
                raise FlightFailed(f"the store has lost {error.key}; {AGAIN}") from None
            except Passing as error:
                raise FlightFailed(f"{error}; {AGAIN}") from None
    _tell(outcomes, target, progress)
    for line in held_out_lines(largest(found.held_out, ISLANDS_TOLD)):
        progress.say(line)
    for text in torn_lines(found.held_out):
        progress.say(f"warning: {text}")
    if not found.assembled.placed:
        raise NothingPlaced(
            f"none of {len(sources.files)} frames found a place: there is no map, {_shown(target)} has the reasons"
        )


def _tell(outcomes: Sequence[Outcome], target: str, progress: Progress) -> None:
    """What has become of all frames."""
    states = Counter(state for state, _ in outcomes)
    counts = f"{states.pop(FrameState.PLACED, 0)} of {len(outcomes)} frames placed"
    progress.say(f"{counts}, {states.pop(FrameState.COVERED, 0)} covered: {_shown(target)}")
    for state, count in states.most_common():
        progress.say(f"  {count} {state}")
        if state is not FrameState.DUPLICATE:
            reasons = Counter(reason for other, reason in outcomes if other is state and reason)
            for reason, alike in reasons.most_common(MOST_REASONS):
                progress.say(f"    {alike} x {reason}")


def _shown(target: str) -> str:
    return target if is_bucket(target) else shown_name(Path(target))


def reprocessed(engine: Engine, sources: Sources, config: Config, request: Request) -> Reprocessed:
    """All stages but packing."""
    arrivals = arrivals_of(engine, sources.files, config.frames)
    seen, aside = features_of(engine, arrivals.frames, config)
    seen = without_pattern(engine, seen, config.stitch.features)
    kinds = kinds_of(engine, seen, config)
    pairs = pairs_of(engine, seen, kinds)
    known = registered(engine, seen, kinds, pairs, config.stitch.registration)
    found = assembled(engine, numbered_frames(seen, kinds), known, config.stitch, request.stretch)
    adjusted = adjusted_islands(engine, found)
    chunks = with_relief(engine, adjusted, config.stitch.adjustment.relief)
    held_out = measured(engine, adjusted, [key for key, _ in chunks], config.stitch.adjustment.relief)
    kinds = with_ranges(engine, seen, kinds, chunks, config.paint)
    seen = looked_at(engine, seen, kinds, config)
    bright = compensated(engine, seen, kinds, chunks, config.paint)
    painted = painted_map(engine, bright, config, request.side)
    return Reprocessed(arrivals, seen, aside, found, held_out, bright, painted)


def _pack(engine: Engine, found: Reprocessed, target: str, config: Config) -> list[Outcome]:
    name = shown_name(Path(target.rstrip("/").rpartition("/")[2]))
    with engine.alone("packing"), _room_beside(target) as folder:
        outcomes = packed(engine, found, name, config, folder)
        if is_bucket(target):
            upload(folder, target)
        else:
            move_into_place(folder, Path(target))
    return outcomes


@contextmanager
def _room_beside(target: str) -> Iterator[Path]:
    if is_bucket(target):
        with tempfile.TemporaryDirectory(prefix="gcs-mosaic-packing-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
    else:
        with beside(Path(target) / ARTEFACTS) as folder:
            yield folder
