"""Woods in the wind, and snow beneath a burnt-in display: what is placed, and how well the ground fits.

    python -m tests.benchmarks.woods [--ground woods|snow] [--overlap SHARE ...] [--seeds SEED ...] [--frames N] [--display]

Surveys of 640x480 frames at 100 m with the same overlap along and across (0.5 and 0.7 if none is given), simulated and placed as
live. Of the ground that two frames of one island see, not hidden under crowns in either, it is told how far the map puts it
apart, in pixels of the median frame, and how much of it is on one island at all. Thirty frames of woods take half a minute, of
snow ten seconds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

import sitl.flight
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.mosaic import StitchSettings
from sitl.camera import SWAY, Camera, Scene
from sitl.display import Display
from sitl.geometry import CameraState, pixels_from_ground, rays_from_pixels
from sitl.path import Plan
from sitl.score import Laid, capped, islands_of, lay, quantile, score
from sitl.similarity import lengths
from sitl.world import WOODS
from tests.benchmarks.flown import Flown
from tests.benchmarks.known_flights import Document, document

SIZE = (640, 480)
OVERLAPS = (0.5, 0.7)
EVERY = 12  # pixels between the places of a frame that are looked at
BARE = 0.3  # metres: what is lower is ground
SAME = 0.3  # metres between two places that are one, for the way rays are traced

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bare:
    """Places where a frame sees the ground: pixels (n, 2) and metres (n, 2)."""

    pixels: Floats
    ground: Floats


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.woods", allow_abbrev=False)
    parser.add_argument("--ground", default=WOODS)
    parser.add_argument("--overlap", type=float, nargs="+", default=OVERLAPS)
    parser.add_argument("--seeds", type=int, nargs="+", default=(1,))
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--sway", type=float, default=SWAY, help="metres of the tallest tops")
    parser.add_argument("--display", action="store_true", help="with a display burnt in, a leg and dirt")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    for overlap in asked.overlap:
        for seed in asked.seeds:
            began, flight = time.monotonic(), planned(asked, overlap, seed)
            with_display = ", display" if asked.display else ""
            print(f"{asked.ground} {seed}, overlap {overlap:.0%}{with_display}: {told(flight)}", end="", flush=True)
            print(f" | {time.monotonic() - began:.0f} s", flush=True)


def planned(asked: argparse.Namespace, overlap: float, seed: int) -> sitl.flight.Flight:
    """The flight, not yet rendered."""
    return sitl.flight.plan(
        "survey",
        SIZE,
        seed=seed,
        ground=asked.ground,
        relief=1.0 if asked.ground == WOODS else 0.0,
        sway=asked.sway,
        camera=Camera(display=Display() if asked.display else None),
        route=Plan(frames=asked.frames, forward=overlap, side=overlap),
    )


def told(flight: sitl.flight.Flight) -> str:
    """The flight in one line."""
    placements, truth = placed(flight), flight.truth()
    found, bare = score(truth, placements), {name: bare_ground(flight.scene, state) for name, state in shots(flight)}
    gaps, shared = pair_errors(flight, placements, bare)
    bared = np.mean([len(one.pixels) for one in bare.values()]) / len(places())
    return (
        f"placed {found.placed}/{found.frames}, islands {found.islands}, largest {found.largest}"
        f" | ground seen {bared:.0%}; its pair error, median / 95 % {quantile(gaps, 0.5):.2f} / {quantile(gaps, 0.95):.2f} px"
        f" n={len(gaps)}, {shared:.0%} of it on one island"
    )


def placed(flight: sitl.flight.Flight) -> Document:
    """Every frame read as from its file, placed as live."""
    settings, files = StitchSettings(), dict(zip(flight.names, flight.pictures(), strict=True))

    def features(name: str, how: FeatureSettings) -> Features:
        image = decode_image(files[name])
        assert not isinstance(image, Unreadable), image.reason
        return extract(image, how)

    again = settings.second_look.features(settings.features)
    with Flown(settings, finer=lambda name: features(name, again)) as flown:
        for name in files:
            flown.place(name, features(name, settings.features))
        return document(flown.finish())


def shots(flight: sitl.flight.Flight) -> Iterator[tuple[str, CameraState]]:
    """Names and states."""
    return zip(flight.names, flight.states, strict=True)


def places() -> Floats:
    """(n, 2) pixels all over a frame."""
    x, y = np.meshgrid(*(np.arange(EVERY / 2, side, EVERY) for side in SIZE))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def bare_ground(scene: Scene, state: CameraState) -> Bare:
    """Where a frame sees the ground, of `places`."""
    pixels = places()
    x, y, height = scene.seen(state, rays_from_pixels(scene.camera.lens, pixels))
    ground = np.asarray(np.stack([x, y], axis=1), np.float64)
    seen = (height < BARE) & scene.world.contains(ground)
    return Bare(pixels[seen], ground[seen])


def pair_errors(flight: sitl.flight.Flight, placements: Document, bare: dict[str, Bare]) -> tuple[Floats, float]:
    """Pixels between the positions that two frames of one island give to the ground that both see, and the share of what
    any two frames see that two of one island do."""
    truth, states = flight.truth(), dict(shots(flight))
    islands, _ = islands_of(truth, placements)
    laid = {one.true.name: (number, one) for number, group in islands.items() if len(group) > 1 for one in lay(group)}
    errors, all_shared = [np.empty(0)], 0
    for one, other in combinations(bare, 2):
        pixels, there = shared_places(flight.scene, bare[one], states[other])
        all_shared += len(pixels)
        if one in laid and other in laid and laid[one][0] == laid[other][0]:
            errors.append(apart(laid[one][1], laid[other][1], pixels, there) / truth.gsd)
    gaps = capped(np.concatenate(errors))
    return gaps, len(gaps) / max(1, all_shared)


def shared_places(scene: Scene, bare: Bare, other: CameraState) -> tuple[Floats, Floats]:
    """Pixels (n, 2) of a frame, and of another, where both see the same bare ground."""
    lens = scene.camera.lens
    there = np.asarray(pixels_from_ground(lens, other, bare.ground), np.float64)
    with np.errstate(invalid="ignore"):
        inside = ((there >= 0) & (there <= np.array(SIZE) - 1)).all(1)
    if not inside.any():
        return there[inside], there[inside]
    x, y, _ = scene.seen(other, rays_from_pixels(lens, there[inside]))
    away = np.asarray(np.stack([x, y], axis=1), np.float64) - bare.ground[inside]
    open_there = lengths(away) < SAME
    return bare.pixels[inside][open_there], there[inside][open_there]


def apart(one: Laid, other: Laid, pixels: Floats, there: Floats) -> Floats:
    """(n,) metres between the positions given to pixels of one frame and of another."""
    return lengths(one.ground(pixels) - other.ground(there))


if __name__ == "__main__":
    main()
