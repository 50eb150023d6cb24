"""What an archive costs: core seconds a frame by stage, the serial share, and by a model fitted to that what more workers bring.

    python -m tests.benchmarks.archive FRAMES|DIR... [--workers 1 2] [--model 8 64] [--frames 100000 1000000]

Each run begins without artefacts. The model is of an idle cluster: a stage of one task takes its core seconds; another one these
divided by the workers, but never less than its longest task. What the machine took beyond that is printed as worker seconds for
each core second. For larger archives core seconds grow with the frames, and so does the longest task of a serial stage: measured
for the adjustment (adjustment_at_scale.py), hoped for the others. Joining grows by levels, each of which costs about the same a
frame; where a measured archive had no level, what its islands cost a frame stands for it.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from gcs_mosaic.archive.progress import Lines, StageCost
from gcs_mosaic.archive.reprocess import Request, reprocess
from gcs_mosaic.archive.stretches import JOINED, STRETCH
from gcs_mosaic.config.tree import Config

HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class StageModel:
    """A stage of an archive: core seconds, those of its longest task, and whether there is but one."""

    stage: str
    core_s: float
    longest_s: float
    serial: bool

    def seconds(self, workers: int) -> float:
        """On so many workers."""
        return self.core_s if self.serial else max(self.core_s / workers, self.longest_s)

    def grown(self, times: float) -> StageModel:
        """Of an archive so many times as large."""
        longest = self.longest_s * times if self.serial else self.longest_s
        return StageModel(self.stage, self.core_s * times, longest, self.serial)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", nargs="+", type=Path)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--model", type=int, nargs="+", default=[8, 64])
    parser.add_argument("--frames", type=int, nargs="+", default=[100_000, 1_000_000])
    asked = parser.parse_args()
    runs = {workers: measured(asked.sources, workers) for workers in asked.workers}
    frames = next(cost.tasks for cost in runs[asked.workers[0]] if cost.stage == "features")
    for workers, costs in runs.items():
        wall, used = sum(cost.wall_s for cost in costs), sum(cost.wall_s * min(workers, cost.tasks) for cost in costs)
        print(f"{workers} workers: {wall:.0f} s, {core(costs) / frames:.2f} core s a frame, ", end="")
        print(f"{used / core(costs):.1f} worker seconds for each core second")
    stages = modelled(runs[max(runs)])
    table(stages, frames)
    for workers in asked.model:
        told(f"{frames} frames, {workers} workers", stages, workers)
    for count in asked.frames:
        for workers in asked.model:
            told(f"{count} frames, {workers} workers", grown(stages, frames, count), workers)


def measured(sources: Sequence[Path], workers: int) -> list[StageCost]:
    """The costs of all stages on so many workers of this machine."""
    lines = Lines(Console(stderr=True))
    with tempfile.TemporaryDirectory(prefix="gcs-mosaic-benchmark-") as folder:
        request = Request(tuple(map(str, sources)), f"{folder}/map", workers=workers)
        reprocess(request, Config(), lines)
    return lines.costs


def core(costs: Sequence[StageCost]) -> float:
    return sum(cost.core_s for cost in costs)


def modelled(costs: Sequence[StageCost]) -> list[StageModel]:
    """Stages, with levels of painting taken together."""
    grouped: dict[str, list[StageCost]] = {}
    for cost in costs:
        grouped.setdefault(cost.stage.partition(",")[0], []).append(cost)
    return [
        StageModel(stage, core(some), max(cost.longest_s for cost in some), stage in SERIAL)
        for stage, some in grouped.items()
    ]


SERIAL = ("islands", "adjustment", "gains", "vocabulary", "packing")  # stages of one task, or one for each island


def grown(stages: Sequence[StageModel], frames: int, to: int) -> list[StageModel]:
    """The stages of an archive of `to` frames, by those of one of `frames`."""
    others = [one.grown(to / frames) for one in stages if one.stage != JOINING]
    levels = len(lengths_joined(frames))
    of_level = sum(one.core_s for one in stages if one.stage == (JOINING if levels else "islands")) / max(levels, 1)
    return others + [
        StageModel(
            f"{JOINING} {length} frames", of_level * to / frames, of_level * min(length, to) / frames, serial=False
        )
        for length in lengths_joined(to)
    ]


def lengths_joined(frames: int) -> list[int]:
    """Frames that a task joins, by level, as in `stretches.placed_stretches`."""
    found, parts, length = list[int](), math.ceil(frames / STRETCH), STRETCH
    while parts > JOINED:
        parts, length = math.ceil(parts / JOINED), length * JOINED
        found.append(length)
    return found


JOINING = "joining"


def table(stages: Sequence[StageModel], frames: int) -> None:
    print(f"{'stage':18}{'core s a frame':>16}{'longest task s':>16}")
    for one in stages:
        print(f"{one.stage:18}{one.core_s / frames:16.4f}{one.longest_s:16.2f}{'   serial' if one.serial else ''}")
    serial = sum(one.core_s for one in stages if one.serial)
    print(f"serial share {serial / sum(one.core_s for one in stages):.1%}")


def told(what: str, stages: Sequence[StageModel], workers: int) -> None:
    """How long it takes by the model, and which stage takes most of that."""
    total = sum(one.seconds(workers) for one in stages)
    most = sorted(stages, key=lambda one: -one.seconds(workers))[:3]
    bounds = ", ".join(f"{one.stage} {one.seconds(workers) / total:.0%}" for one in most)
    span = f"{total:.0f} s" if total < HOUR_S else f"{total / HOUR_S:.1f} h"
    print(f"{what}: {span}; most of it {bounds}")


if __name__ == "__main__":
    main()
