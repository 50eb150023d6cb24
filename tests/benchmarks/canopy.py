"""People beneath leaves: how much better an integral shows them than single frames do, by looks and by what leaves hide.

    python -m tests.benchmarks.canopy [--kind thermal|colour] [--hidden D ...] [--seeds SEED ...] [--poses true|own]

Surveys of 320x256 frames at 50 m with 30 looks at each place, of which 5, 10, 20 or 30 are taken, over a forest's floor beneath
leaves 4 to 12 m high that sway; 25 people lie and sit on a hectare. Contrast is what a person's middle differs from the ground
around, in standard deviations of that ground: the median over people in the integral (mean), over that in the best of the same
single frames, and what the statistical model of Kurmi, Schedl and Bimber (IEEE Sensors Journal 19(20), 2019) lets expect.
Recall is the share of people among the hints that stand out more than all but one false hint a hectare: by warmth through gaps
(in colour: RX on the mean), by the same where nobody knows how large a person is, by RX on the mean, by each of the same single
frames, of which each place's most telling one counts, and by one frame for each place; of the first and the last it is told by
how much of a person leaves hide. What `hot_places` is made of was chosen on seeds 1 and 2.
`--poses own`: those of the map that is made of the frames, at the focus that is best for people. A seed takes about a minute of
computing for each share hidden.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

import sitl.flight
from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.integral.forms import FORMS
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid_together
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from tests.benchmarks.canopy_own import own_looks
from tests.benchmarks.canopy_pictures import write_pictures
from tests.benchmarks.canopy_scene import Model, hidden_of, model_of, pictures, planned, true_looks
from tests.benchmarks.canopy_scores import WAYS, Scored, by_hiding, recall, scored, taken

LOOKS = (5, 10, 20, 30)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.canopy", allow_abbrev=False)
    parser.add_argument("--kind", choices=("thermal", "colour"), default="thermal")
    parser.add_argument("--hidden", type=float, nargs="+", default=(0.5, 0.7, 0.9))
    parser.add_argument("--seeds", type=int, nargs="+", default=(1, 2))
    parser.add_argument("--poses", choices=("true", "own"), default="true")
    parser.add_argument("--picture", type=Path, help="write the integrals of one person here")
    parser.add_argument("--speed", action="store_true", help="what a change of the focus costs instead")
    parser.add_argument("--looks", type=int, nargs="+", choices=LOOKS, default=LOOKS)
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    if asked.speed:
        speed()
        return
    print("hidden looks | contrast: integral, best single, gain, model |", end="")
    print(" recall at 1 false/ha: through gaps, of any size, mean, all singles, one | by hiding")
    for hidden in asked.hidden:
        began = time.monotonic()
        flights = [planned(hidden, seed, asked.kind) for seed in asked.seeds]
        told(asked, hidden, flights)
        print(f"  {time.monotonic() - began:.0f} s", flush=True)


def speed() -> None:
    """Milliseconds of one core for a change of the focus: 30 looks of 12 MP in memory, a window of 400 px, by form."""
    rng, camera = np.random.default_rng(1), Camera(4000, 3000, k1=-0.04)
    poses = [
        Pose(float(x), float(y), 0.0, 0.1, 0.02, -0.02) for x in range(-1000, 1001, 400) for y in range(-800, 801, 400)
    ]
    window, looks = GroundWindow(0.0, 0.0, 400.0, 400), list[GroundLook]()
    for number, pose in enumerate(poses):
        x, y = pixels_at(pose, camera, None, np.zeros((1, 2)), 0.0)[0]
        left, top = float(max(0, x // 1 - 400)), float(max(0, y // 1 - 400))
        image = rng.random((800, 800, 3), np.float32) * 255
        looks.append(GroundLook(f"{number}", pose, camera, image, left=left, top=top))
    for name, form in FORMS.items():
        times = []
        for height in (0.0, 20.0, 40.0, 60.0, 80.0):
            began = time.process_time()
            form(laid_together(looks, window, height))
            times.append(1000 * (time.process_time() - began))
        print(f"{name:>9}: {np.median(times):4.0f} ms a change of the focus, {len(looks)} looks", flush=True)


def told(asked: argparse.Namespace, hidden: float, flights: Sequence[sitl.flight.Flight]) -> None:
    """One line for each number of looks, of all flights together."""
    gathered: dict[int, list[Scored]] = {count: [] for count in asked.looks}
    models: list[Model] = []
    hidden_people: list[list[float]] = []
    for flight in flights:
        images = pictures(flight, asked.kind)
        models.append(model_of(flight, images))
        hidden_people.append(hidden_of(flight))
        looks, unit, height = (own_looks if asked.poses == "own" else true_looks)(flight, images)
        for count in asked.looks:
            gathered[count].append(scored(taken(looks, count), flight.scene.targets, unit, height))
        if asked.picture:
            write_pictures(asked.picture, hidden, looks, flight.scene.targets[12], unit, height)
    print(f"  hidden as measured {np.mean([one.hidden for one in models]):.1%}")
    for count, found in gathered.items():
        print(f"  {hidden:.0%} {count:3d} | {line(found, count, models)} | {hiding(found, hidden_people)}", flush=True)


def line(found: Sequence[Scored], count: int, models: Sequence[Model]) -> str:
    """Medians and recalls."""
    contrast = np.median([each for one in found for each in one.contrasts])
    single = np.median([each for one in found for each in one.best_single])
    expected = np.mean([one.contrast(count) for one in models])
    people = [len(one.contrasts) for one in found]
    recalls = [recall([one.hints[way] for one in found], people) for way in WAYS]
    shares = " ".join(f"{one:4.0%}" for one in recalls)
    return f"{contrast:5.2f} {single:5.2f} {contrast / single:5.2f} {expected:5.2f} | {shares}"


def hiding(found: Sequence[Scored], hidden: Sequence[Sequence[float]]) -> str:
    """People found through gaps, and by one frame, of those there, by how much of them leaves hide."""
    ways = {way: by_hiding([one.hints[way] for one in found], hidden) for way in ("warm", "one")}
    return "; ".join(
        f"{way}: " + ", ".join(f"to {limit:.0%} {seen}/{there}" for limit, (seen, there) in told.items())
        for way, told in ways.items()
    )


if __name__ == "__main__":
    main()
