"""Long simulated flights, placed frame by frame with their adjustments beside, as live, and judged by their known truth.

    python -m tests.benchmarks.long_flights [FRAMES ...] [--relief HEIGHTS]

FRAMES: 200, 1000 and 3000 if none are given. A survey of 640x480 frames with 60 % side lap, wind, tilts to 15 degrees, a
climb to three times the height every 300 frames and a lens with k1 = -0.1; `--relief 1` with hills, houses and trees
instead of flat ground. Rendering takes most of the time: about half a second a frame.

Beside what was reached stands the best possible with one homography per frame, each fitted to the truth alone.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Iterator
from contextlib import closing

import cv2
import numpy as np

import sitl.flight
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.features.extraction import Features, extract
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from sitl.camera import Camera
from sitl.geometry import Lens
from sitl.path import Plan
from sitl.score import score
from sitl.truth import Truth
from tests.benchmarks.known_flights import document

COUNTS = (200, 1000, 3000)
SIZE = (640, 480)
LENS = Lens(k1=-0.1)
FRAMES_PER_CLIMB = 300
SAID_EVERY = 250  # frames


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.long_flights", allow_abbrev=False)
    parser.add_argument("counts", nargs="*", type=int, default=COUNTS, metavar="FRAMES")
    parser.add_argument("--relief", type=float, default=0.0, metavar="HEIGHTS", help="0 is flat, 1 hilly with trees")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    for count in given.counts:
        fly(count, given.relief)


def fly(count: int, relief: float) -> None:
    """Place a flight of so many frames, and print how well it lies."""
    flight = survey(count, relief)
    truth = flight.truth()
    best = best_homographies(truth)
    print(f"{count} frames, relief {relief:g}: best homographies {np.sqrt((best**2).mean()):.2f} px", flush=True)
    settings = StitchSettings()
    seconds = []
    with closing(WorkerProcess()) as worker:
        mosaic = Mosaic(settings, worker)
        for number, (name, features) in enumerate(zip(flight.names, seen_by(flight, settings), strict=False), 1):
            start = time.process_time()
            mosaic.place(features, name)
            mosaic.adjust()
            mosaic.moved()
            seconds.append(time.process_time() - start)
            if number % SAID_EVERY == 0:
                print(f"  {number} frames: {np.median(seconds[-SAID_EVERY:]):.2f} s of CPU each", flush=True)
        mosaic.retry_waiting()
        mosaic.adjust(everything=True)
    gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"  {score(truth, document(mosaic.placements()))} | memory {gigabytes:.1f} GB", flush=True)
    if mosaic.problem:
        print(f"  {mosaic.problem}")


def survey(count: int, relief: float) -> sitl.flight.Flight:
    """The flight, planned and not yet rendered, over ground that is large enough for it."""
    return sitl.flight.plan("survey", SIZE, camera=Camera(lens=LENS), relief=relief, route=long_route(count))


def long_route(count: int) -> Plan:
    """Lines with 75 % and 60 % overlap, tilts to 15 degrees, wind, a climb every 300 frames."""
    climbs = max(1, count // FRAMES_PER_CLIMB)
    return Plan(frames=count, forward=0.75, side=0.6, height=50.0, tilt=math.radians(15), wind=5.0, climbs=climbs)


def seen_by(flight: sitl.flight.Flight, settings: StitchSettings) -> Iterator[Features]:
    """The features of each frame, as if it had been read from its file."""
    for number, state in enumerate(flight.states):
        image = decode_image(flight.scene.encoded(state, number))
        assert not isinstance(image, Unreadable), image.reason
        yield extract(image, settings.features)


def best_homographies(truth: Truth) -> np.ndarray:
    """Distances (n,) of true grid points from where the best homography of each frame puts them, in pixels."""
    errors = []
    for frame in truth.frames:
        pixels, ground = frame.grid_px[frame.grid_used], frame.grid_ground[frame.grid_used]
        if len(pixels) >= 4:
            middle = ground.mean(axis=0)
            homography, _ = cv2.findHomography(pixels, ground - middle, 0)
            placed = cv2.perspectiveTransform(pixels[None].astype(float), homography)[0] + middle
            errors.append(np.linalg.norm(placed - ground, axis=1) / truth.gsd)
    return np.concatenate(errors)


if __name__ == "__main__":
    main()
