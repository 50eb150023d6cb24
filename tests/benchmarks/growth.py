"""How the cost of a frame and of an adjustment grows with the flight: 75, 300, 1,000 and 3,000 frames.

    python -m tests.benchmarks.growth [FRAMES ...]

One flight of marks (`flight_of_points`): a survey with 60 % side lap, wind, tilts to 15 degrees and climbs to three times the
height. CPU seconds, so that a machine that does other things as well may be used; good for ratios. Nothing here says how
good the map is.

place: a frame's search, matching and resection, over the last frames before the count is reached. warm: the adjustment of all
frames as the flight left them; cold: with every pose and the lens off. hand over, take in: what of a background adjustment
happens between two frames. query: the wide search for the frames most like one. In the end what it costs to write the frames
of such a flight down (`writing`).
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from gcs_mosaic.stitch.bundle.island import IslandTask, adjusted, island_task, take_in
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic
from tests.benchmarks import writing
from tests.benchmarks.flight_of_points import features_of_flight

T = TypeVar("T")

COUNTS = (75, 300, 1000, 3000)
LATEST = 50  # frames over which placing is told
QUERIES = 10
ADJUSTED_UNTIL = 300  # frames; from then on only at the counts and each time the island has grown by a half
TITLES = ("frames", "place", "95 %", "warm", "cold", "hand over", "take in", "query", "memory MB")


def main() -> None:
    counts = sorted(map(int, sys.argv[1:])) or list(COUNTS)
    print("CPU seconds\n" + "".join(f"{title:>11}" for title in TITLES), flush=True)
    mosaic, places, adjusted_at, lost = Mosaic(), [], 0, 0
    for number, features in enumerate(features_of_flight(counts[-1]), start=1):
        outcome, seconds = timed(lambda f=features, n=number: mosaic.place(f, str(n)))  # type: ignore[misc]
        places.append(seconds)
        lost += not isinstance(outcome, Placement)
        if number <= ADJUSTED_UNTIL or number >= 1.5 * adjusted_at:
            mosaic.adjust(everything=number > ADJUSTED_UNTIL)
            adjusted_at = number
        mosaic.moved()
        if number in counts:
            report(mosaic, number, np.array(places[-LATEST:]))
    print(f"{lost} frames found no place at once\n\nledger and documents")
    writing.report(counts[-1])


def report(mosaic: Mosaic, count: int, places: np.ndarray) -> None:
    graph, settings = mosaic._graph, AdjustmentSettings()
    task, handing = timed(lambda: island_task(graph, 0, settings))
    assert task is not None, "a flight has links"
    warm, warm_s = timed(lambda: adjusted(task))
    _, cold_s = timed(lambda: adjusted(disturbed(task)))
    _, taking = timed(lambda: take_in(graph, task, warm))
    columns = [*np.quantile(places, [0.5, 0.95]), warm_s, cold_s, handing, taking, query(mosaic)]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{count:11}" + "".join(f"{seconds:11.3f}" for seconds in columns) + f"{memory:11}", flush=True)


def disturbed(task: IslandTask) -> IslandTask:
    """All poses off by some pixels and a third of a degree, the lens as it is before any frame has come."""
    rng, problem = np.random.default_rng(1), task.problem
    off = rng.normal(size=problem.poses.shape) * [5.0, 5.0, 0.005, 0.005, 0.005, 0.005]
    lenses = np.zeros_like(problem.lenses)
    lenses[:, 0] = np.log(task.settings.focal_prior)
    return replace(task, problem=replace(problem, poses=problem.poses + off, lenses=lenses))


def query(mosaic: Mosaic) -> float:
    """Median seconds of asking all frames for those most like one."""
    placed = mosaic._graph.placed()
    asked = placed[np.linspace(0, len(placed) - 1, QUERIES).astype(int)].tolist()
    return float(np.median([timed(lambda f=f: mosaic._search.likeliest(f, placed))[1] for f in asked]))  # type: ignore[misc]


def timed(work: Callable[[], T]) -> tuple[T, float]:
    start = time.process_time()
    done = work()
    return done, time.process_time() - start


if __name__ == "__main__":
    main()
