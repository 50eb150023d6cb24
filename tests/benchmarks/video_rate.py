"""What frames cost that show next to nothing new: a slow pass and a hover, filmed, with covering and without.

    python -m tests.benchmarks.video_rate [FRAMES] [--most-new SHARE ...]

Simulated pictures of 752x480 from 100 m over a known ground. pass: steps of 0.7 m (99 % overlap) along lines with a turn
between them; hover: station keeping within a few metres and degrees. place: CPU seconds of `Mosaic.place` and `Mosaic.adjust`
for a frame that is placed and one that is covered, features not included, medians. ortho, pairs: errors against the truth in
pixels, of the placed frames and of all that have a place.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.graph.placement import Covered, Placement
from gcs_mosaic.stitch.mapping.covering import CoverSettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from sitl.flight import Flight, camera_names, plan
from sitl.geometry import CameraState
from sitl.path import Plan
from sitl.score import score
from sitl.truth import Truth

SIZE = 752, 480
HEIGHT = 100.0  # metres: one per cent of a picture's length is 0.7 m
PER_STATION = 25  # frames filmed from one station of an ordinary flight (75 % overlap) to the next


@dataclass(frozen=True, slots=True)
class Film:
    """Frames of video rate and their truth."""

    name: str
    features: Sequence[Features]
    names: Sequence[str]
    truth: Truth
    extracting_s: float  # median


def main() -> None:
    parser = argparse.ArgumentParser(description="What frames cost that show next to nothing new.")
    parser.add_argument("frames", type=int, nargs="?", default=150)
    parser.add_argument("--most-new", type=float, nargs="*", default=[CoverSettings().most_new])
    asked = parser.parse_args()
    for film in (filmed("pass", passing(asked.frames)), filmed("hover", hovering(asked.frames))):
        print(f"{film.name}, {len(film.names)} frames, features {film.extracting_s:.3f} s", flush=True)
        print("  " + measured(film, CoverSettings(enabled=False)), flush=True)
        for most_new in asked.most_new:
            print("  " + measured(film, CoverSettings(most_new=most_new)), flush=True)


def passing(frames: int) -> Flight:
    """An ordinary flight, filmed."""
    stations = -(-frames // PER_STATION) + 1
    flight = plan("survey", SIZE, cache=Path(gettempdir()), route=Plan(frames=max(2, stations), height=HEIGHT))
    return film_of(flight, list(between(flight.states))[:frames])


def hovering(frames: int, seed: int = 3) -> Flight:
    """One place, kept as a multirotor keeps it: slow swings of metres and degrees."""
    flight = plan("survey", SIZE, cache=Path(gettempdir()), route=Plan(frames=4, height=HEIGHT))
    rng = np.random.default_rng(seed)
    phases, periods = rng.uniform(0, 2 * np.pi, 6), rng.uniform(80, 200, 6)
    swings = np.array([1.0, 1.0, 0.5, 0.01, 0.006, 0.006])  # metres and radians
    moved = swings * np.sin(phases + 2 * np.pi * np.arange(frames)[:, None] / periods)
    still = CameraState(time=0.0, x=0.0, y=0.0, height=HEIGHT)
    return film_of(flight, [plus(still, row, float(k)) for k, row in enumerate(moved)])


def film_of(flight: Flight, states: list[CameraState]) -> Flight:
    return replace(flight, states=tuple(states), names=tuple(camera_names(len(states))))


def between(states: Sequence[CameraState]) -> Iterator[CameraState]:
    """Evenly from each state to the next, the shorter way round."""
    for here, there in pairwise(states):
        way = numbers(there) - numbers(here)
        way[3] = (way[3] + np.pi) % (2 * np.pi) - np.pi
        yield from (plus(here, way * k / PER_STATION, here.time + k) for k in range(PER_STATION))


def plus(state: CameraState, moved: NDArray[np.float64], moment: float) -> CameraState:
    x, y, height, yaw, pitch, roll = (numbers(state) + moved).tolist()
    return CameraState(time=moment, x=x, y=y, height=height, yaw=yaw, pitch=pitch, roll=roll)


def numbers(state: CameraState) -> NDArray[np.float64]:
    return np.array([state.x, state.y, state.height, state.yaw, state.pitch, state.roll])


def filmed(name: str, flight: Flight) -> Film:
    """A flight's pictures, seen and forgotten."""
    found, seconds = [], []
    for index, state in enumerate(flight.states):
        picture = flight.scene.picture(state, index)
        start = time.process_time()
        found.append(extract(picture, FeatureSettings()))
        seconds.append(time.process_time() - start)
    return Film(name, found, flight.names, flight.truth(), float(np.median(seconds)))


def measured(film: Film, cover: CoverSettings) -> str:
    """One line about a way to stitch a film."""
    mosaic = Mosaic(StitchSettings(cover=cover))
    seconds: dict[type, list[float]] = {Placement: [], Covered: []}
    for name, features in zip(film.names, film.features, strict=True):
        start = time.process_time()
        outcome = mosaic.place(features, name)
        mosaic.adjust()
        seconds.setdefault(type(outcome), []).append(time.process_time() - start)
    mosaic.adjust(everything=True)
    placed, covered = seconds[Placement], seconds[Covered]
    how = f"most_new {cover.most_new:g}" if cover.enabled else "without covering"
    parts = [f"{how}: {len(placed)} placed, {len(covered)} covered", f"place {middle(placed)} / {middle(covered)} s"]
    if covered:
        parts.append(f"{np.median(covered) / np.median(placed):.0%}")
    parts += [f"in all {sum(map(sum, seconds.values())):.1f} s", errors(film, mosaic, with_covered=False)]
    return ", ".join([*parts, errors(film, mosaic, with_covered=True)] if covered else parts)


def middle(seconds: list[float]) -> str:
    return f"{np.median(seconds):.3f}" if seconds else "-"


def errors(film: Film, mosaic: Mosaic, *, with_covered: bool) -> str:
    found = score(film.truth, document(mosaic, with_covered=with_covered))
    whose = "all" if with_covered else "placed"
    return f"{whose}: ortho {found.ortho_rmse:.2f}, pairs {found.pair_median:.2f} / {found.pair_p95:.2f} px"


def document(mosaic: Mosaic, *, with_covered: bool) -> dict[str, Any]:
    """As much of placements.json as is judged."""
    placed = {placement.name: placement for placement in mosaic.placements()}
    entries = [(p.name, p, p.canvas_from_frame) for p in placed.values()]
    if with_covered:
        entries += [(c.name, placed[c.by], c.canvas_from_frame(placed[c.by])) for c in mosaic.covered()]
    return {
        "frames": [
            {
                "name": name,
                "island": keyframe.island,
                "canvas_from_frame": homography.tolist(),
                "width": SIZE[0],
                "height": SIZE[1],
            }
            for name, keyframe, homography in entries
        ]
    }


if __name__ == "__main__":
    main()
