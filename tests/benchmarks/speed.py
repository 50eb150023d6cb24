"""How fast the program is on this machine, in one run.

    python -m tests.benchmarks.speed FOLDER [--part stitch live overload growth start ...] [--most 75] [--interval 2]
        [--scale 1] [--keep]

FOLDER holds the frames of a flight. Wall time on a machine that may do other things as well, so what counts are ratios to the
floor of the same run: decoding, one warp of the whole frame and the JPEG encoding of the tiles under its footprint, on one
thread (`floors`). For each release, with the row that it adds:

    python -m tests.benchmarks.speed ../shared/data/caliterra --part stitch --most 12 --keep

stitch: the command at 100, 50 and 25 % of the size, its start and its final painting included, and its stages (`speed_costs`);
the median of --repeats runs at each, in turn, compared with the last kept row of the same frames (`speed_table`). Exit code 1 if
a stage has become slower by more than a tenth. --keep: keeps the row, and renders the page of figures. live: a frame each
--interval seconds over real UDP, with the page open in a browser; the time from a file being whole to its last tile, and from
Ctrl-C to the end. overload: frames at three times the rate at which they can be processed; how long it takes until a frame, or a
newer one, is on the map. growth: a long simulated flight, its last frames against early ones (`long_growth`). start: see `start`.
*cores*: seconds of all cores over seconds on the wall. *resident*: of all processes together.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gcs_mosaic.config.tree import Config
from tests.benchmarks import figures, speed_table, start
from tests.benchmarks.floors import Floor, floor_of
from tests.benchmarks.flown_live import FlownLive, fly, pictures_in
from tests.benchmarks.long_growth import growth_lines
from tests.benchmarks.side_by_side import Failed, each
from tests.benchmarks.speed_costs import Costs, Work, measured
from tests.benchmarks.speed_table import Row

PARTS = ("stitch", "live", "overload", "growth", "start")
SCALES = (1.0, 0.5, 0.25)
OVERLOAD = 3  # frames come in the time in which one can be processed


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be measured, and how."""

    pictures: list[Path]
    interval_s: float
    runs: int
    long: int  # frames of a long flight
    scale: float  # of the frames that are flown live


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.speed", allow_abbrev=False)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--most", type=int, help="frames; all if not given")
    parser.add_argument("--interval", type=float, default=2.0, metavar="SECONDS")
    parser.add_argument("--scale", type=float, default=1.0, help="of live: 1, 0.5 or 0.25")
    parser.add_argument("--runs", type=int, default=5, help="starts")
    parser.add_argument("--long", type=int, default=2000, metavar="FRAMES")
    parser.add_argument("--repeats", type=int, default=3, help="of stitch, at each scale")
    parser.add_argument("--keep", action="store_true", help="add what stitch costs to the rows that are compared with")
    given = parser.parse_args()
    task = Task(pictures_in(given.folder, given.most), given.interval, given.runs, given.long, given.scale)
    is_slower = "stitch" in given.part and stitch(task, given)
    measures: dict[str, Callable[[Task], Iterator[str]]] = {
        "live": live,
        "overload": overload,
        "growth": growth,
        "start": starts,
    }
    for part, measure in measures.items():
        for line in measure(task) if part in given.part else ():
            tell(part, line)
    return int(is_slower)


def tell(part: str, line: str) -> None:
    print(f"{part:>9}  {line}", flush=True)


def stitch(task: Task, given: argparse.Namespace) -> bool:
    """Tell what all frames cost at each scale; whether that is more than it was."""
    before = speed_table.read(speed_table.KEPT)
    row = stitched(task.pictures, speed_table.begun(given.folder.resolve().name, len(task.pictures), given.repeats))
    last = speed_table.last_like(before, row)
    slower = speed_table.slower(row, last) if last else []
    compared = f"compared with {last}" if last else "no row of these frames was kept before"
    for line in (*speed_table.lines(row), compared, *(slower or ["no stage is slower"] * bool(last))):
        tell("stitch", line)
    if given.keep:
        speed_table.keep(speed_table.KEPT, row)
        figures.main()
    return bool(slower)


def stitched(pictures: Sequence[Path], row: Row) -> Row:
    """The row with its costs. All scales take turns, each in a process of its own. Ends the program if one fails."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program itself has it
    runs: dict[float, list[Costs]] = {scale: [] for scale in SCALES}
    works = [Work(tuple(pictures), scale) for _ in range(row.repeats) for scale in SCALES]
    for work, found in each(measured, works):
        if isinstance(found, Failed):
            sys.exit(f"at {work.scale:.0%}: {found}")
        runs[work.scale].append(found)
    return replace(row, scales={f"{scale:.0%}": speed_table.median(costs) for scale, costs in runs.items()})


def live(task: Task) -> Iterator[str]:
    with TemporaryDirectory() as scratch:
        flown = fly(task.pictures, task.interval_s, Path(scratch), f"scale: {task.scale:g}\n")
        floor = floor_of(flown.out, Config(scale=task.scale))
    yield f"{floor_words(floor)}"
    yield f"a frame each {task.interval_s:g} s, whole file to last tile: {quantiles(flown.latencies)}"
    yield from ending(flown)


def overload(task: Task) -> Iterator[str]:
    """At a rate that is found with some frames that come all at once."""
    with TemporaryDirectory() as scratch:
        work_s = fly(task.pictures[:16], 0.0, Path(scratch)).seconds_a_frame
    with TemporaryDirectory() as scratch:
        flown = fly(task.pictures, work_s / OVERLOAD, Path(scratch))
        floor = floor_of(flown.out, Config())
    yield f"{floor_words(floor)}"
    yield f"a frame each {work_s / OVERLOAD:.2f} s: it or a newer one on the map after {quantiles(flown.newest_late)}"
    lost = len(task.pictures) - len(flown.done)
    each = flown.seconds_a_frame
    yield f"all filled in after {max(flown.latencies):.1f} s, {lost} lost; {each:.2f} s, {each / floor.all:.2f} floors each"
    yield from ending(flown)


def growth(task: Task) -> Iterator[str]:
    with TemporaryDirectory() as scratch:
        yield from growth_lines(task.long, Path(scratch))


def starts(task: Task) -> Iterator[str]:
    runs = [start.started(task.pictures[0].read_bytes()) for _ in range(task.runs)]
    for stage, seconds in zip(start.STAGES, zip(*runs, strict=True), strict=True):
        yield f"{stage}: {quantiles(seconds)}"


def ending(flown: FlownLive) -> Iterator[str]:
    cores = flown.cpu_s / flown.wall_s
    memory = f"{flown.resident_mb:.0f} MB resident, {flown.largest_mb:.0f} of them the largest process"
    yield f"{cores:.2f} cores, {memory}; final map {flown.final_s:.1f} s after Ctrl-C, ended after {flown.end_s:.1f} s"


def floor_words(floor: Floor) -> str:
    parts = f"decode {floor.decode:.3f}, warp {floor.warp:.3f}, encode {floor.encode:.3f}"
    return f"the floor is {floor.all:.3f} s ({parts})"


def quantiles(seconds: Sequence[float]) -> str:
    """Median, 95 % and the most."""
    half, most, all_ = np.quantile(seconds, [0.5, 0.95, 1.0])
    return f"p50 {half:.2f} s, p95 {most:.2f} s, max {all_:.2f} s"


if __name__ == "__main__":
    sys.exit(main())
