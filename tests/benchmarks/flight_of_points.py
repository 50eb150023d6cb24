"""A long simulated flight without pictures: the features of each frame are marks on the ground that it sees.

Every mark has a random descriptor of its own and a size at which it is seen, as SIFT's have: a frame sees marks of about
the size of its pixels. Good for times; no map of it says anything about accuracy, for which pictures must be rendered.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features.extraction import Features
from sitl.geometry import CameraState, Lens, ground_from_pixels, pixels_from_ground
from sitl.path import CLIMB_RATIO, Plan, fly

LENS = Lens(width=640, height=480, k1=-0.1)
HEIGHT = 50.0  # metres, before any climb
SEEN = 1000  # marks in a frame: half of what a textured ground gives, for descriptors of marks never fail to match
NOISE_PX = 0.3  # of a mark's place in a frame
NOISE_DESCRIPTOR = 6.0  # of 255
CELL = 30.0  # metres: marks are kept by cells of this side


def plan(frames: int) -> Plan:
    """60 % side lap, tilts to 15 degrees, wind, and a climb to three times the height and back every 300 frames."""
    return Plan(frames=frames, height=HEIGHT, tilt=np.radians(15.0), wind=5.0, climbs=max(1, frames // 300))


def features_of_flight(frames: int, seed: int = 1) -> Iterator[Features]:
    """Features (at most SEEN) of each frame in turn."""
    return features_of_states(fly("survey", LENS, plan(frames)), seed)


def features_of_states(
    states: Iterable[CameraState], seed: int = 1, seen: int = SEEN, shared: Collection[tuple[int, int]] = ()
) -> Iterator[Features]:
    """Features (at most `seen`) of what is seen from each place in turn. `shared`: cells of CELL metres, by their numbers in x
    and y, where all grounds are alike."""
    rng, ground = np.random.default_rng([seed, 7]), _Ground(seed, shared)
    for state in states:
        places, descriptors = ground.marks(state)
        pixels = pixels_from_ground(LENS, state, places) + rng.normal(0, NOISE_PX, places.shape)
        inside = np.flatnonzero(((pixels >= 0) & (pixels < [LENS.width, LENS.height])).all(axis=1))[:seen]
        noisy = descriptors[inside] + rng.normal(0, NOISE_DESCRIPTOR, (len(inside), 128))
        told = np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)
        yield Features(pixels[inside].astype(np.float32), told, LENS.width, LENS.height, 1.0)


class _Ground:
    """Marks on the plane, made cell by cell as they are seen; each level of size has its own."""

    def __init__(self, seed: int, shared: Collection[tuple[int, int]]) -> None:
        self._seed, self._shared = seed, frozenset(shared)
        self._cells: dict[tuple[int, int, int], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def marks(self, state: CameraState) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Places (n, 2) in metres and descriptors (n, 128) of the marks around a frame, of the two sizes next to its own."""
        corners = np.array([[0, 0], [LENS.width, 0], [LENS.width, LENS.height], [0, LENS.height]], np.float64)
        outline = ground_from_pixels(LENS, state, corners)
        low, high = np.floor(outline.min(axis=0) / CELL).astype(int), np.floor(outline.max(axis=0) / CELL).astype(int)
        size = int(np.floor(2 * np.log(state.height / HEIGHT) / np.log(CLIMB_RATIO) + 0.5))
        keys = [
            (s, x, y) for s in (size, size + 1) for x in range(low[0], high[0] + 1) for y in range(low[1], high[1] + 1)
        ]
        found = [self._cell(key) for key in keys]
        places, descriptors = (np.concatenate([part[k] for part in found]) for k in (0, 1))
        order = np.argsort(descriptors[:, 0], kind="stable")  # strength is a thing of the mark, not of its place
        return places[order], descriptors[order]

    def _cell(self, key: tuple[int, int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if key not in self._cells:
            size, x, y = key
            seed = 0 if (x, y) in self._shared else self._seed
            rng = np.random.default_rng([seed, size + 10, x + 1000, y + 1000])
            across, along = LENS.footprint(HEIGHT * CLIMB_RATIO ** (size / 2))
            count = rng.poisson(SEEN * CELL**2 / (across * along))
            raw = rng.gamma(0.5, size=(count, 128))
            places = (rng.random((count, 2)) + np.array([x, y])) * CELL
            self._cells[key] = places, 255 * np.sqrt(raw / raw.sum(axis=1, keepdims=True))
        return self._cells[key]
