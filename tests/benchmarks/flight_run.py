"""One recorded flight, stitched and judged: the figures that tell how good its map is, and what it cost."""

from __future__ import annotations

import io
import math
import re
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
from rich.console import Console

from gcs_mosaic.app.commands import batch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.export.export import export_placements
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import DamagedFile, Frame
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.mapping.second_look import Finer
from gcs_mosaic.stitch.mosaic import Mosaic
from tests.benchmarks.exif import position_in
from tests.benchmarks.feature_cache import FeatureFinder
from tests.benchmarks.flown import Flown
from tests.benchmarks.gps_fit import fits
from tests.benchmarks.known_flights import SHARED, Document, document, known_flight, read_document
from tests.benchmarks.refusals import Refusals, grouped
from tests.benchmarks.stages import Stages

PER_MB = 1 << 20 if sys.platform == "darwin" else 1 << 10  # ru_maxrss is in bytes there, elsewhere in kilobytes


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be run. `full`: the real program with painting, else the core alone; `cache`: where features are kept."""

    folder: Path
    scale: float
    full: bool = False
    cache: Path | None = None

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    @property
    def config(self) -> Config:
        return Config(scale=self.scale)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What became of a flight; None where it cannot be told.

    islands: frames of each island of two or more, the largest first; alone: frames that are an island by themselves;
    covered: frames that placed ones show, which are not painted.
    held_out_*: how far the map tears matches apart that it was not fitted to, pixels. gps_rms_m: over the frames of all
    islands that can be laid over their GPS positions; gps_worst_m: of the island that fits worst, gps_mirrored: islands.
    ortho, tracks: see known_flights.Result. refused: pairs and poses by reason; unplaced: frames by reason;
    troubles: what adjusting raised, how often. *_s: by stage. error: why there is no map.
    """

    name: str
    frames: int = 0
    islands: tuple[int, ...] = ()
    alone: int = 0
    covered: int | None = None
    held_out_median_px: float | None = None
    held_out_p95_px: float | None = None
    gps_rms_m: float | None = None
    gps_worst_m: float | None = None
    gps_mirrored: int | None = None
    ortho_px: float | None = None
    tracks_median_px: float | None = None
    tracks_p95_px: float | None = None
    refused: dict[str, int] = field(default_factory=dict)
    unplaced: dict[str, int] = field(default_factory=dict)
    troubles: dict[str, int] = field(default_factory=dict)
    cpu_s: dict[str, float] = field(default_factory=dict)
    wall_s: dict[str, float] = field(default_factory=dict)
    memory_mb: int | None = None
    error: str | None = None

    @property
    def placed(self) -> int:
        """Frames that share an island with others."""
        return sum(self.islands)


def run(task: Task) -> Run:
    """Stitch a flight and judge its map. Meant for a process of its own: memory is that of the whole process."""
    cv2.setNumThreads(1)
    return _run_full(task) if task.full else _run_core(task)


def held_out_px(mosaic: Mosaic) -> tuple[float, float] | None:
    """Median and 95 % of the distances by which the largest island tears held-out matches apart; None: too few to tell."""
    found = max(mosaic.held_out().values(), key=lambda island: island.matches, default=None)
    return (found.median_px, found.p95_px) if found else None


def held_out_px_of(flight: Path) -> tuple[float, float] | None:
    """The same of the output folder of a flight."""
    islands = [island["held_out_px"] for island in read_document(flight / "mosaic.json")["islands"]]
    found = max(filter(None, islands), key=lambda entry: entry["matches"], default=None)
    return (found["median"], found["p95"]) if found else None


def _run_core(task: Task) -> Run:
    """Features, placing and adjusting alone."""
    config, refusals, reading = task.config, Refusals(), Stages()
    finder = FeatureFinder(config.stitch.features, config.reduction, task.cache)
    items = list(frames_in([task.folder], config.frames).frames)
    frames, lost = _distinct(items)
    with Flown(config.stitch, refusals, _second_look(task, frames)) as flown:
        for frame in frames:
            with reading.timed("features"):
                features = finder.features_of(frame)
            if isinstance(features, str):
                lost.append(features)
            else:
                flown.place(frame.name, features)
        map_, memory_mb = document(flown.finish()), _memory_mb()
        held_out, covered = held_out_px(flown.mosaic), len(flown.mosaic.covered())
    costs = flown.stages
    costs.cpu_s["adjust"] += _cpu_of_children()
    is_fresh = finder.found == len(frames)  # what comes out of the cache does not tell what finding it costs
    if is_fresh:
        costs.include(reading)
    lost += flown.unplaced.values()
    found = Run(
        name=task.name,
        frames=len(items),
        covered=covered,
        refused=dict(refusals.counts.most_common()),
        unplaced=_counted(lost),
        troubles=_counted(flown.troubles),
        cpu_s=dict(costs.cpu_s),
        wall_s=dict(costs.wall_s),
        memory_mb=memory_mb if is_fresh else None,
    )
    return _judged(found, task.folder, map_, held_out)


def _second_look(task: Task, frames: Iterable[Frame]) -> Finer:
    """Finds the finer features of frames by their names."""
    stitch, named = task.config.stitch, {frame.name: frame for frame in frames}
    finder = FeatureFinder(stitch.second_look.features(stitch.features), task.config.reduction, task.cache)

    def finer(name: str) -> Features | None:
        found = finder.features_of(named[name])
        return None if isinstance(found, str) else found

    return finer


def _run_full(task: Task) -> Run:
    """The real program, judged by what it leaves behind; its painting and writing count as stages, too."""
    said, whole = Console(file=io.StringIO(), width=200), Stages()
    with tempfile.TemporaryDirectory(prefix="gcs-mosaic-benchmark-") as scratch:
        with whole.timed("all"):
            flight = batch.stitch([task.folder], Path(scratch) / "flight", task.config, said)
        whole.cpu_s["all"] += _cpu_of_children()
        memory_mb, target = _memory_mb(), Path(scratch) / "placements.json"
        export_placements(flight, target)
        map_, accounts, held_out = read_document(target), read_document(flight / "mosaic.json"), held_out_px_of(flight)
    assert isinstance(said.file, io.StringIO)
    lost = [entry["reason"] for entry in map_["rejected"]] + accounts["frames"].get("damaged", 0) * ["damaged"]
    found = Run(
        name=task.name,
        frames=sum(accounts["frames"].values()),
        covered=accounts["frames"]["covered"],
        unplaced=_counted(lost),
        cpu_s=dict(whole.cpu_s),
        wall_s=dict(whole.wall_s) | _told_seconds(said.file.getvalue()),
        memory_mb=memory_mb,
    )
    return _judged(found, task.folder, map_, held_out)


def _distinct(items: Iterable[Frame | DamagedFile]) -> tuple[list[Frame], list[str]]:
    """Frames as the product takes them, each picture once, and why the other files are none."""
    frames: dict[str, Frame] = {}
    lost = []
    for item in items:
        if isinstance(item, DamagedFile):
            lost.append(item.reason)
        elif item.content_hash in frames:
            lost.append("the same picture as an earlier one")
        else:
            frames[item.content_hash] = item
    return list(frames.values()), lost


def _judged(found: Run, folder: Path, map_: Document, held_out: tuple[float, float] | None) -> Run:
    """A run with all that can be told of its map."""
    counts = Counter(entry["island"] for entry in map_["frames"]).values()
    found = replace(
        found,
        islands=tuple(sorted((count for count in counts if count > 1), reverse=True)),
        alone=sum(count == 1 for count in counts),
        held_out_median_px=held_out and held_out[0],
        held_out_p95_px=held_out and held_out[1],
    )
    return _against_reference(_against_gps(found, folder, map_), folder, map_)


def _against_gps(found: Run, folder: Path, map_: Document) -> Run:
    frames = [item for item in frames_in([folder]).frames if isinstance(item, Frame)]
    positions = {frame.name: position for frame in frames if (position := position_in(frame.path)) is not None}
    islands = fits(map_["frames"], positions)
    if not islands:
        return found
    squares = sum(island.frames * island.rms_m**2 for island in islands)
    return replace(
        found,
        gps_rms_m=math.sqrt(squares / sum(island.frames for island in islands)),
        gps_worst_m=max(island.rms_m for island in islands),
        gps_mirrored=sum(island.mirrored for island in islands),
    )


def _against_reference(found: Run, folder: Path, map_: Document) -> Run:
    reference = SHARED / "data" / "truth" / f"{folder.resolve().name}.json"
    if not found.islands or not (reference.exists() or (folder / "truth.json").exists()):
        return found
    result = known_flight(folder.resolve()).judge(map_)
    return replace(
        found,
        ortho_px=_finite(result.ortho_px),
        tracks_median_px=_finite(result.tracks_median_px),
        tracks_p95_px=_finite(result.tracks_p95_px),
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _counted(reasons: Iterable[str]) -> dict[str, int]:
    return dict(Counter(map(grouped, reasons)).most_common())


def _told_seconds(said: str) -> dict[str, float]:
    """Seconds by stage out of the table at the end of `gcs-mosaic stitch`."""
    totals = {stage: re.search(rf"\b{stage}\b(?:\W+[\d.]+){{2}}\W+([\d.]+)", said) for stage in batch.STAGES}
    return {stage: float(total[1]) for stage, total in totals.items() if total}


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // PER_MB
