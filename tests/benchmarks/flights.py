"""What a change to the stitcher is judged by: all recorded flights, stitched, judged, compared with the last kept run.

    python -m tests.benchmarks.flights [NAME|DIR ...] [--scale 0.25,1] [--full] [--jobs N] [--cache DIR] [--keep] [--pairs]

NAME: a folder of data/ beside the project; DIR: any folder of frames; without either, all folders of data/ that hold frames.
Features are found as by `gcs-mosaic stitch --scale`, frames placed and adjusted, nothing painted; `--full` runs the whole
program. Frames smaller than some 10 MP show less at 0.25 than at 1: `--scale 0.25,1` runs all at both. `--cache` keeps
features between runs, so that a change to the placing is judged in seconds. `--keep` makes what was found the state to
compare with (flights.json). `--pairs` only tells which consecutive frames match, and why not.

Rows: frames on islands of two or more, of all; frames alone; frames that placed ones cover; pixels by which held-out matches
are torn apart; metres that remain of GPS positions after a similarity per island, over all and of the worst island; pixels to
the true place of matched points, and between two frames' places of one (known_flights.Result); CPU seconds by stage; peak
memory; sizes of islands.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import frames_in
from tests.benchmarks import flight_table
from tests.benchmarks.flight_run import Run, Task, run
from tests.benchmarks.known_flights import SHARED
from tests.benchmarks.pair_report import pairs
from tests.benchmarks.side_by_side import Failed, each


def main() -> int:
    given = _parser().parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # either way, nothing goes on running
    chosen = folders(given.flights)
    tasks = [Task(folder, scale, given.full, given.cache) for scale in given.scale for folder in chosen]
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # threads that wait for each other would be counted as work
    try:
        return print_pairs(tasks, given.jobs) if given.pairs else print_runs(tasks, given)
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.flights", allow_abbrev=False)
    parser.add_argument("flights", nargs="*", metavar="NAME|DIR", help="recorded flights (all of data/)")
    parser.add_argument("--scale", type=scales, default=(0.25,), metavar="S[,S]", help="1, 0.5 or 0.25, some of them")
    parser.add_argument("--full", action="store_true", help="the whole program, with painting, into a scratch folder")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="flights at a time (1)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep features there between runs")
    parser.add_argument("--compare", type=Path, default=flight_table.KEPT, metavar="FILE", help="with these runs")
    parser.add_argument("--keep", action="store_true", help="write what was found into the file that is compared with")
    parser.add_argument("--pairs", action="store_true", help="match consecutive frames, nothing else")
    return parser


def scales(text: str) -> tuple[float, ...]:
    """Scales out of "0.25,1". ValueError if one is none that frames are decoded at."""
    return tuple(Config(scale=float(part)).scale for part in text.split(","))


def folders(given: Iterable[str]) -> list[Path]:
    """Folders by name or path, or all of data/ that hold frames; ends the program if one is not there, or if two have one name,
    under which their runs are kept."""
    data = SHARED / "data"
    chosen = [path if (path := Path(name)).is_dir() else data / name for name in given]
    for path in chosen:
        if not holds_frames(path):
            sys.exit(f"{path} holds no frames: give a folder of them, or the name of one in {data}")
    for one, other in combinations(chosen, 2):
        if one.resolve().name == other.resolve().name:
            sys.exit(
                f"{one} and {other} have one name, under which runs are kept: give them one at a time, or rename one"
            )
    return chosen or [path for path in sorted(data.iterdir()) if holds_frames(path)]


def holds_frames(path: Path) -> bool:
    try:
        return frames_in([path]).count > 0
    except UsageError:
        return False


def print_runs(tasks: list[Task], given: argparse.Namespace) -> int:
    """Print a table of all that come to an end; 1 if one of them has failed."""
    before, found = flight_table.read(given.compare), dict[str, Run]()
    print(flight_table.HEADER, flush=True)
    try:
        for task, outcome in each(run, tasks, given.jobs):
            name = flight_table.key(task.name, task.scale, task.full)
            found[name] = Run(name=task.name, error=outcome.reason) if isinstance(outcome, Failed) else outcome
            print("\n".join(flight_table.row(name, found[name], before.get(name))), flush=True)
    finally:
        print(flight_table.summary(found, before), flush=True)
    if given.keep:
        flight_table.write(given.compare, found)
    return int(any(one.error for one in found.values()))


def print_pairs(tasks: list[Task], jobs: int) -> int:
    """Print how many consecutive frames register, and why the others do not."""
    failed = False
    for task, outcome in each(pairs, [replace(task, full=False) for task in tasks], jobs):
        failed |= isinstance(outcome, Failed)
        print(f"{flight_table.key(task.name, task.scale, False)}: {outcome}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
