"""What each kind of proposal is worth where keypoints do not suffice.

    OMP_NUM_THREADS=1 python -m tests.benchmarks.proposals [NAME|DIR ...]

Recorded flights (all, or these), placed at a quarter of the size with all kinds, without pictures, and without one kind at a
time: `homographies` and `similarities` of the matches, the last `motion`, the neighbours' `poses`, all shifts of frames in
`sequence`, the `second look`. Rows: frames on islands of two and more, islands, the largest, core seconds of placing.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from gcs_mosaic.stitch.graph import candidates
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.mapping.second_look import SecondLook
from gcs_mosaic.stitch.registration import registration
from gcs_mosaic.stitch.registration.agreement import PixelPair
from tests.benchmarks.flight_run import Run, Task, run
from tests.benchmarks.flights import folders

SCALE = 0.25


def nothing(*_: Any, **__: Any) -> None:
    """What is proposed by a kind that is left out."""


def without_homographies() -> Any:
    found = registration._by_keypoints
    return patch.object(registration, "_by_keypoints", lambda *given: (found(*given)[0], []))


def without(owner: Any, name: str, instead: Callable[..., Any] = lambda *_, **__: []) -> Callable[[], Any]:
    return lambda: patch.object(owner, name, instead)


KINDS: dict[str, Callable[[], Any]] = {
    "all": lambda: patch.object(registration, "HYPOTHESES", registration.HYPOTHESES),
    "no pictures": without(PixelPair, "known", False),  # type: ignore[arg-type]
    "no homographies": without_homographies,
    "no similarities": without(registration, "similarities"),
    "no motion": without(Search, "_by_last_motion"),
    "no poses": without(candidates, "BY_POSE", -math.inf),  # type: ignore[arg-type]
    "no sequence": without(PixelPair, "best_shifts"),
    "no second look": without(SecondLook, "next_pair", nothing),
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.proposals", allow_abbrev=False)
    parser.add_argument("flights", nargs="*", metavar="NAME|DIR", help="recorded flights (all of data/)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep features there between runs")
    asked = parser.parse_args()
    for folder in folders(asked.flights):
        print(folder.name)
        for kind, leave_out in KINDS.items():
            with leave_out():
                print(f"  {kind:16s} {told(run(Task(folder, SCALE, cache=asked.cache)))}", flush=True)


def told(found: Run) -> str:
    """A flight in one line."""
    islands = " ".join(map(str, found.islands))
    return f"{found.placed:3d} of {found.frames}, {len(found.islands)} ({islands}), {found.cpu_s['place']:.1f} s"


if __name__ == "__main__":
    main()
