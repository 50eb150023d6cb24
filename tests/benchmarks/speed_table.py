"""Rows of what stitching costs, kept from release to release, and which stage has become slower since the last one."""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from tests.benchmarks.speed_costs import Costs

KEPT = Path(__file__).with_name("speed.json")
SHARE = 0.1  # by so much more a stage is slower
LEAST = 0.03  # floors a frame: less is chance
QUIET = 0.25  # of the cores in use before a run: up to then its time by the clock tells of the program


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One run. `load`: tasks that wanted a core before it began, over the last minute; `scales`: costs by scale, as in "50 %"."""

    flight: str
    frames: int
    repeats: int
    day: str
    commit: str
    cores: int
    processor: str
    load: float
    scales: dict[str, Costs] = field(default_factory=dict)

    def __str__(self) -> str:
        where = f"{self.cores} cores of {self.processor}, load {self.load:.1f} before"
        return f"{self.day}, commit {self.commit}, {where}; {self.frames} frames of {self.flight}, median of {self.repeats}"

    @property
    def is_quiet(self) -> bool:
        return self.load <= QUIET * self.cores


def begun(flight: str, frames: int, repeats: int) -> Row:
    """A row of this day, commit and machine, still without costs."""
    return Row(
        flight=flight,
        frames=frames,
        repeats=repeats,
        day=date.today().isoformat(),
        commit=_commit(),
        cores=os.cpu_count() or 1,
        processor=_processor(),
        load=os.getloadavg()[0],
    )


def _commit() -> str:
    """With a + if the files are others."""
    here = Path(__file__).parent
    said = [
        subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=True).stdout.strip()
        for words in (("rev-parse", "--short=10", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
    ]
    return said[0] + ("+" if said[1] else "")


def _processor() -> str:
    told = Path("/proc/cpuinfo").read_text().splitlines()
    names = (line.partition(":")[2].strip() for line in told if line.startswith("model name"))
    return next(names, platform.machine())


def median(runs: Sequence[Costs]) -> Costs:
    """Of each figure by itself; a stage counts as nothing where a run has not heard of it."""
    names = {name: None for run in runs for name in run.stages}
    return Costs(
        floor_s=statistics.median(run.floor_s for run in runs),
        wall=statistics.median(run.wall for run in runs),
        cpu=statistics.median(run.cpu for run in runs),
        resident_mb=statistics.median(run.resident_mb for run in runs),
        stages={name: statistics.median(run.stages.get(name, 0.0) for run in runs) for name in names},
    )


def read(path: Path) -> list[Row]:
    """The kept rows, the oldest first; none where there is no file."""
    entries: list[dict[str, Any]] = json.loads(path.read_text()) if path.exists() else []
    return [
        Row(**entry | {"scales": {scale: Costs(**costs) for scale, costs in entry["scales"].items()}})
        for entry in entries
    ]


def keep(path: Path, row: Row) -> None:
    """Add a row."""
    path.write_text(json.dumps([_rounded(asdict(one)) for one in (*read(path), row)], indent=1) + "\n")


def last_like(rows: Sequence[Row], row: Row) -> Row | None:
    """The newest that measured the same frames."""
    return next((one for one in reversed(rows) if (one.flight, one.frames) == (row.flight, row.frames)), None)


def slower(now: Row, before: Row) -> list[str]:
    """Each stage that has become slower by more than a tenth, or is not there any more, in words."""
    by_clock = now.is_quiet and before.is_quiet and now.cores == before.cores
    return [
        f"SLOWER at {scale}: {words}"
        for scale, old in before.scales.items()
        for words in _slower_at(now.scales.get(scale), old, by_clock)
    ]


def _slower_at(now: Costs | None, before: Costs, by_clock: bool) -> Iterator[str]:
    if now is None:
        yield "not measured now"
        return
    old, new = figures(before), figures(now)
    if not by_clock:  # of a machine that did other things, or another one
        del old["wall"]
    for name, was in old.items():
        if name not in new:
            yield f"{name} is missing, it was {was:.2f} floors a frame"
        elif new[name] - was > max(SHARE * was, LEAST):
            yield f"{name} {was:.2f} -> {new[name]:.2f} floors a frame"


def figures(costs: Costs) -> dict[str, float]:
    """All that is compared, in floors a frame."""
    return {"wall": costs.wall, "all cores": costs.cpu, **costs.stages}


def lines(row: Row) -> Iterator[str]:
    """The row in words, a line for each scale."""
    yield str(row)
    for scale, costs in row.scales.items():
        whole = (
            f"{costs.wall:.2f} floors a frame by the clock, {costs.cpu:.2f} of all cores, {costs.resident_mb:.0f} MB"
        )
        stages = ", ".join(f"{name} {floors:.2f}" for name, floors in _largest_first(costs.stages))
        yield f"{scale}: {whole}; the floor is {costs.floor_s:.3f} s; {stages}"


def page_rows(path: Path = KEPT) -> list[list[str]]:
    """For the page of figures: the newest row first, a line for each scale."""
    return [_page_row(row, scale, costs) for row in reversed(read(path)) for scale, costs in row.scales.items()]


def _page_row(row: Row, scale: str, costs: Costs) -> list[str]:
    machine = f"{row.cores} cores of {row.processor}, load {row.load:.1f}"
    stages = ", ".join(f"{name} {floors:.2f}" for name, floors in _largest_first(costs.stages))
    whole = [f"{costs.wall:.1f}", f"{costs.cpu:.1f}", f"{costs.resident_mb:.0f}", f"{costs.floor_s:.2f}"]
    return [f"{row.day} {row.commit}", machine, str(row.frames), scale, *whole, stages]


def _largest_first(stages: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(stages.items(), key=lambda item: -item[1])


def _rounded(entry: Any) -> Any:
    if isinstance(entry, dict):
        return {name: _rounded(value) for name, value in entry.items()}
    return round(entry, 4) if isinstance(entry, float) else entry
