"""How an adjustment grows with the flight: surveys of 3,000, 10,000 and 30,000 frames whose matches are given.

    python -m tests.benchmarks.adjustment_at_scale [FRAMES ...] [--level] [--links 12] [--compare 10000] [--tolerance 3e-4]

CPU seconds on one BLAS thread, each number of frames in a process of its own (`survey_of_matches` makes the flight, with climbs
to three times the height or `--level`). Each pose begins some pixels and a third of a degree off and the whole bent, the lens as
it is before any frame has come; the adjustment goes on until it has converged, as in a flight: when a step has lowered the cost
by less than that share (`--tolerance`).

all: the adjustment, and each of its steps; order: of elimination, found once for all steps; factor: one factorisation with its
solution; certainty: standard deviations of all frames, afterwards. MB: the most memory of the process until then; made: before
the adjustment, with the survey in it. error: RMS distance of the frames' inner corners from the truth.

SuperLU: scipy's general solver on the first equations of the same adjustment, for so many frames at most (`--compare`): seconds,
multiples of ours, how far its step lies from ours relative to the largest part of it, and the most memory of the process then.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from gcs_mosaic.stitch.bundle import levenberg_marquardt
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, adjust
from gcs_mosaic.stitch.bundle.normal_equations import solve
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.uncertainty import island_certainty
from tests.benchmarks.superlu import superlu_step
from tests.benchmarks.survey_of_matches import CAMERA, LINKS, Survey, rms_error_px, survey

T = TypeVar("T")

COUNTS = (3000, 10_000, 30_000)
COMPARED = 10_000  # frames: of 30,000 SuperLU's factors take 4 GB
DAMPING = 1e-4  # of an adjustment's first step
TITLES = ("frames", "pairs", "steps", "all", "each", "order", "factor", "certainty", "MB", "made", "error px")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("frames", nargs="*", type=int, default=COUNTS)
    parser.add_argument("--level", action="store_true")
    parser.add_argument("--links", type=int, default=LINKS)
    parser.add_argument("--compare", type=int, default=COMPARED)
    parser.add_argument("--tolerance", type=float, default=AdjustmentSettings().step_tolerance)
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.here:
        settings = replace(AdjustmentSettings(), step_tolerance=asked.tolerance)
        report(survey(asked.frames[0], asked.links, level=asked.level), asked.compare, settings)
        return
    print("".join(f"{title:>10}" for title in TITLES), flush=True)
    options = [f"--{name}={getattr(asked, name)}" for name in ("links", "compare", "tolerance")]
    options += ["--level"] if asked.level else []
    for count in asked.frames:
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", __spec__.name, str(count), "--here", *options]
        subprocess.run(command, env=environment, check=True)


def report(flight: Survey, compare: int, settings: AdjustmentSettings) -> None:
    frames, made = len(flight.truth), memory_mb()
    seconds = defaultdict[str, list[float]](list)
    for name in ("layout_of", "solve"):
        setattr(levenberg_marquardt, name, watched(getattr(levenberg_marquardt, name), seconds[name]))
    solution, total = timed(lambda: adjust(flight.problem, settings))
    _, certainty = timed(lambda: island_certainty(flight.problem, solution, [CAMERA], 0, settings.loss_px))
    columns = [
        *(f"{number:10}" for number in (frames, len(flight.problem.pairs), solution.steps)),
        *(f"{number:10.2f}" for number in (total, total / solution.steps, sum(seconds["layout_of"]))),
        *(f"{number:10.2f}" for number in (np.median(seconds["solve"]), certainty)),
        *(f"{number:10}" for number in (memory_mb(), made)),
        f"{rms_error_px(solution.poses, solution.lenses, flight.truth):10.2f}",
    ]
    print("".join(columns), flush=True)
    if frames <= compare:
        compare_with_superlu(flight.problem, settings)


def compare_with_superlu(problem: Problem, settings: AdjustmentSettings) -> None:
    state = levenberg_marquardt._first_state(problem, settings)
    ours, seconds = timed(lambda: solve(state.normal, state.gradient, DAMPING))
    theirs, of_superlu = timed(lambda: superlu_step(state.normal, state.gradient, DAMPING))
    assert ours is not None, "a damped normal matrix is positive definite"
    scale = np.sqrt(np.maximum(state.normal.diagonal, 1e-12))
    off = abs((ours - theirs) * scale).max() / abs(theirs * scale).max()
    print(
        f"{'':10}SuperLU {of_superlu:.2f} s, {of_superlu / seconds:.1f} times ours, {off:.0e} from it; {memory_mb()} MB",
        flush=True,
    )


def watched(work: Callable[..., T], seconds: list[float]) -> Callable[..., T]:
    """The same, with the seconds of each call noted."""

    def watching(*arguments: Any) -> T:
        done, taken = timed(lambda: work(*arguments))
        seconds.append(taken)
        return done

    return watching


def timed(work: Callable[[], T]) -> tuple[T, float]:
    start = time.process_time()
    done = work()
    return done, time.process_time() - start


def memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


if __name__ == "__main__":
    main()
