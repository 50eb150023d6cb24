"""How fast the program is on this machine, in one run.

    python -m tests.benchmarks.speed FOLDER [--part stitch live overload growth start ...] [--most 75] [--interval 2]

FOLDER holds the frames of a flight. Wall time on a machine that may do other things as well, so what counts are ratios to the
floor of the same run: decoding, one warp of the whole frame and the JPEG encoding of the tiles under its footprint, on one
thread (`floors`).

stitch: the command, at 100, 50 and 25 % of the size, its start and its final painting included. live: a frame each --interval
seconds over real UDP, with the page open in a browser; the time from a file being whole to its last tile, and from Ctrl-C to
the end. overload: frames at three times the rate at which they can be processed; how long it takes until a
frame, or a newer one, is on the map. growth: a long simulated flight, its last frames
against early ones (`long_growth`). start: see `start`. *cores*: seconds of all cores over seconds on the wall. *resident*:
of all processes together.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gcs_mosaic.config.tree import Config
from tests.benchmarks import start
from tests.benchmarks.floors import Floor, floor_of
from tests.benchmarks.flown_live import FlownLive, fly, pictures_in
from tests.benchmarks.long_growth import growth_lines
from tests.benchmarks.processes import Watched

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


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.speed", allow_abbrev=False)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--most", type=int, help="frames; all if not given")
    parser.add_argument("--interval", type=float, default=2.0, metavar="SECONDS")
    parser.add_argument("--runs", type=int, default=5, help="starts")
    parser.add_argument("--long", type=int, default=2000, metavar="FRAMES")
    given = parser.parse_args()
    task = Task(pictures_in(given.folder, given.most), given.interval, given.runs, given.long)
    measures: dict[str, Callable[[Task], Iterator[str]]] = {
        "stitch": stitch,
        "live": live,
        "overload": overload,
        "growth": growth,
        "start": starts,
    }
    for part in given.part:
        for line in measures[part](task):
            print(f"{part:>9}  {line}", flush=True)


def stitch(task: Task, scales: Sequence[float] = SCALES) -> Iterator[str]:
    """The whole command on all frames, at each scale."""
    for scale in scales:
        with TemporaryDirectory() as scratch:
            out, frames = Path(scratch) / "mosaic", len(task.pictures)
            words = ["stitch", *map(str, task.pictures), "--out", str(out), "--scale", str(scale)]
            begun = time.monotonic()
            command = [sys.executable, "-m", "gcs_mosaic", *words]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=start.environment())
            with Watched(process.pid) as watched:
                assert process.wait() == 0, "the command ends well"
            wall = time.monotonic() - begun
            floor = floor_of(out, Config(scale=scale))
        yield f"{scale:.0%}: {floor_words(floor)}"
        ratio = (
            f"{wall / frames / floor.all:.2f} floors a frame, {(wall - 20) / frames / floor.all:.2f} with 20 s let off"
        )
        yield f"{scale:.0%}: {wall:.1f} s for {frames} frames, {wall / frames:.2f} s each; {ratio}; {used(watched, wall)}"


def live(task: Task) -> Iterator[str]:
    with TemporaryDirectory() as scratch:
        flown = fly(task.pictures, task.interval_s, Path(scratch))
        floor = floor_of(flown.out, Config())
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
    yield f"{cores:.2f} cores, {memory}; final map {flown.end_s:.1f} s after Ctrl-C"


def used(watched: Watched, wall_s: float) -> str:
    return f"{watched.cpu_s / wall_s:.2f} cores, {watched.resident_mb:.0f} MB resident"


def floor_words(floor: Floor) -> str:
    parts = f"decode {floor.decode:.3f}, warp {floor.warp:.3f}, encode {floor.encode:.3f}"
    return f"the floor is {floor.all:.3f} s ({parts})"


def quantiles(seconds: Sequence[float]) -> str:
    """Median, 95 % and the most."""
    half, most, all_ = np.quantile(seconds, [0.5, 0.95, 1.0])
    return f"p50 {half:.2f} s, p95 {most:.2f} s, max {all_:.2f} s"


if __name__ == "__main__":
    main()
