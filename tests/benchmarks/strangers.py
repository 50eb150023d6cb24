"""A second visit after hundreds of frames elsewhere: `python -m tests.benchmarks.strangers [FRAMES]` (500; about a second each).

Frames over a first land, then FRAMES over another that has the same halls, then the first land again. Says how many of each
were placed and on which islands; anything but one island per land is a false or a missed join.

`python -m tests.benchmarks.strangers --mixed [FRAMES]`: as many frames (20) of either of two recorded flights in turn, for all
pairs of flights; an island that holds frames of both is a false join.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from itertools import combinations, zip_longest

from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.flight import plan
from sitl.path import Plan
from tests.benchmarks.recorded import RECORDED, photographs, read

FIRST_VISIT, SECOND_VISIT = 10, 10
SIZE = (640, 480)


def frames(seed: int, count: int) -> Iterator[Features]:
    """Features of a survey over land with halls of one make."""
    flight = plan("survey", SIZE, seed=seed, ground="halls", route=Plan(frames=count, height=60))
    for k, state in enumerate(flight.states[:count]):
        yield extract(flight.scene.picture(state, k), FeatureSettings())


def main(elsewhere: int = 500) -> None:
    mosaic = Mosaic()
    known = list(frames(1, FIRST_VISIT + SECOND_VISIT))
    visits = {"first": known[:FIRST_VISIT], "elsewhere": frames(2, elsewhere), "second": known[FIRST_VISIT:]}
    for visit, taken in visits.items():
        for k, features in enumerate(taken):
            mosaic.place(features, f"{visit} {k}")
            mosaic.adjust()
    mosaic.retry_waiting()
    for (visit, island), count in sorted(Counter((p.name.split()[0], p.island) for p in mosaic.placements()).items()):
        print(f"{visit}: {count} frames on island {island}")
    print(f"waiting: {len(mosaic.waiting())}")


def mixed(count: int = 20) -> None:
    print(f"{'flights':22} placed of each, false joins")
    for one, other in combinations(RECORDED, 2):
        flights = [photographs(flight)[:count] for flight in (one, other)]
        mosaic = Mosaic()
        for path in (path for together in zip_longest(*flights) for path in together if path):
            mosaic.place(read(path), f"{path.parent.name} {path.name}")
            mosaic.adjust()
        mosaic.retry_waiting()
        seen = Counter((p.name.split()[0], p.island) for p in mosaic.placements())
        placed = Counter(flight for flight, island in seen.elements())
        worlds = Counter(island for _, island in seen)
        false = sum(flights > 1 for flights in worlds.values())
        counts = ", ".join(f"{placed[f]} of {len(p)}" for f, p in zip((one, other), flights, strict=True))
        print(f"{one + ' + ' + other:22} {counts}, {false}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--mixed"]:
        mixed(*map(int, sys.argv[2:]))
    else:
        main(*map(int, sys.argv[1:]))
