"""A second visit after hundreds of frames elsewhere: `python -m tests.benchmarks.strangers [FRAMES]` (500; about a second each).

Frames over a first land, then FRAMES over another that has the same halls, then the first land again. Says how many of each
were placed and on which islands; anything but one island per land is a false or a missed join.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator

from gcs_mosaic.stitch.matching.features import Features, FeatureSettings, extract
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.flight import plan
from sitl.path import Plan

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


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
