"""How much a map of two or three frames should trust what they say of their tilt, on a flight whose truth is known.

    python -m tests.benchmarks.few_frames DIR [FRAMES]

Every second run of FRAMES (2) frames in a row is stitched by itself, with the prior on tilts as it is, wider, and so narrow
that all frames look straight down: a choice between the camera over a plane and the plain similarity, by its outcome. The
prior weighs the same evidence for each flight: what the matches do not show stays level.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs_mosaic.stitch.mosaic import StitchSettings
from tests.benchmarks.known_flights import Named, Result, document, features_in, known_flight, stitched

FACTORS = {"as it is": 1.0, "wider": 3.0, "narrower": 0.3, "level": 0.01}


def main(folder: Path, size: int = 2) -> None:
    settings = StitchSettings()
    flight, frames = known_flight(folder), features_in(folder, settings.features)
    for label, factor in FACTORS.items():
        sigma = settings.adjustment.tilt_prior_sigma * factor
        weighed = replace(settings, adjustment=replace(settings.adjustment, tilt_prior_sigma=sigma))
        found = [flight.judge(document(stitched(run, weighed))) for run in runs(frames, size)]
        print(f"{label:>9}, {sigma:.3f} rad: {summary(found, size)}", flush=True)


def runs(frames: list[Named], size: int) -> list[list[Named]]:
    """Every second run of so many frames in a row."""
    return [frames[start : start + size] for start in range(0, len(frames) - size + 1, 2)]


def summary(found: list[Result], size: int) -> str:
    ortho = [one.ortho_px for one in found if one.placed == size and np.isfinite(one.ortho_px)]
    median, worse = np.quantile(ortho, [0.5, 0.9])
    return f"{len(ortho)} of {len(found)} whole, ortho {median:.1f} px in the median, {worse:.1f} px at 90 %"


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
