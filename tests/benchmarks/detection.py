"""Whether the stated probability of detection is met: python -m tests.benchmarks.detection [--fit] [--keep DIR]

Simulated flights with people (`detection_scene`). What would be stated is told from the pictures without people; the reader of
fixed rule (see `detection.model`) looks at those with people (`detection_reader`). Printed: how often it found whom it should
have found with 0 to 10 %, 10 to 20 %, ... (reliability diagram), over all and flight by flight. With --fit the coefficients are
fitted to some scenes and written (`detection_fit`); those held out, of other seeds and some of other grounds, are never
fitted to.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gcs_mosaic.detection.model import TABLE, coefficients, written
from tests.benchmarks.detection_fit import FLIGHT, by_flight, fit, told
from tests.benchmarks.detection_reader import Looks, measured
from tests.benchmarks.detection_scene import Setting

FITTED = (
    Setting(ground="country", seed=1, height=30),
    *(Setting(ground="floor", seed=2, height=30, leaves=leaves) for leaves in (0.6, 0.0, 0.85, 0.3)),
    *(Setting(ground="country", seed=1, height=height) for height in (55, 95, 120)),
    *(Setting(ground="snow", seed=1, height=height) for height in (40, 80)),
    Setting(ground="floor", seed=2, height=60, leaves=0.5),
    Setting(ground="suburb", seed=1, height=30),
    Setting(ground="woods", seed=5, height=40, relief=1.0),
    Setting(ground="rows", seed=4, height=40),
    *(Setting(ground="suburb", seed=1, height=height) for height in (55, 95)),
    Setting(ground="cars", seed=4, height=40),
)
HELD_OUT = (
    Setting(ground="country", seed=11, height=25),
    *(Setting(ground="floor", seed=13, height=40, leaves=leaves) for leaves in (0.45, 0.7, 0.15)),
    *(Setting(ground="country", seed=11, height=height) for height in (45, 75, 105)),
    *(Setting(ground="halls", seed=12, height=height) for height in (35, 70)),
    Setting(ground="berries", seed=12, height=35),
    Setting(ground="woods", seed=16, height=50, relief=1.0),
    *(Setting(ground="lake", seed=12, height=height) for height in (35, 60)),
    Setting(ground="snow", seed=12, height=50),
)


def looks_of(settings: Sequence[Setting], keep: Path | None) -> Looks:
    """Of all flights, those kept in a folder used again."""
    tables = []
    for number, setting in enumerate(settings):
        name = f"{setting.ground}-{setting.seed}-{setting.height:g}-{setting.leaves:g}.npy"
        if keep is not None and (keep / name).exists():
            table = np.load(keep / name)
        else:
            began, one = time.monotonic(), measured(setting, keep)
            table = np.array([getattr(one, field) for field in Looks.__dataclass_fields__])
            print(f"{setting}: {table.shape[1]} looks, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
            if keep is not None:
                np.save(keep / name, table)
        tables.append(np.vstack([table[:1] + FLIGHT * number, table[1:]]))
    return Looks(*np.hstack(tables))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.detection")
    parser.add_argument("--fit", action="store_true", help="fit the coefficients and write them")
    parser.add_argument("--keep", type=Path, help="folder for what was measured, which is used again")
    given = parser.parse_args()
    if given.fit:
        looks = looks_of(FITTED, given.keep)
        TABLE.write_text(written(fit(looks)), encoding="utf-8")
        coefficients.cache_clear()
        print(told("fitted", looks, coefficients()))
    held_out = looks_of(HELD_OUT, given.keep)
    print(TABLE.read_text(encoding="utf-8"), end="")
    print(told("held out", held_out, coefficients()))
    flights = by_flight(held_out, coefficients())
    print(f"  error {100 * np.mean([abs(chance - found) for chance, found in flights]):.1f} points by flight")
    for one, (chance, found) in zip(HELD_OUT, flights, strict=True):
        leaves = f", leaves {one.leaves:.0%}" if one.leaves else ""
        print(f"  {one.ground} at {one.height:g} m{leaves}: stated {chance:.0%} found {found:.0%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
