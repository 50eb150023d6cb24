"""An archive without pictures: what its frames and pairs would have brought is put into a store as its tasks find it there.

A flat ground full of marks; each frame sees half of those in its view, with noise, the strongest 2,000. Two frames have matched
what both have seen, and some of what they have not. That is about what caliterra's frames bring (2,000 features, 10 pairs a frame,
450 inliers a pair). No descriptors: nothing after the registrations reads them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.look_up import NumberedFrame
from gcs_mosaic.archive.pairs import KnownPairs, Pair, StoredRegistration
from gcs_mosaic.stitch.arrays import PosesNx6
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.registration import independent_count
from sitl.geometry import CameraState, ground_from_pixels, pixels_from_ground
from sitl.path import fly
from tests.benchmarks.flight_of_points import LENS, NOISE_PX, plan
from tests.benchmarks.survey_of_matches import canvas_pose, linked

SEEN = 2000  # features of a frame at most
REPEATED = 0.55  # share of the marks in view that a frame sees
PAIRED = 20  # frames that one is compared with, at most: 10 pairs a frame
WRONG = 0.08  # matches that are none, for each one that is
FEWEST = 20  # common marks from which a pair is registered
CELL = 25.0  # metres: marks are numbered by cells of this side
TOGETHER = 4  # frames whose pairs lie in one artefact, as in an archive
EVIDENCE = 100.0

Ids = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class ArchiveOfPoints:
    """`poses` (n, 6): the truth, of which one unit is a pixel from the flight's height."""

    frames: list[NumberedFrame]
    known: KnownPairs
    poses: PosesNx6


def archive_of_points(artefacts: Artefacts, frames: int, seed: int = 1) -> ArchiveOfPoints:
    """A survey at one height, put into the store."""
    states = list(fly("survey", LENS, replace(plan(frames), climbs=0)))[:frames]
    poses = np.array([canvas_pose(state) for state in states])
    pairs: dict[int, list[Pair]] = {}
    for a, b in linked(poses, PAIRED).tolist():
        pairs.setdefault(a, []).append((a, b))
    last = {a: max(b for _, b in some) for a, some in pairs.items()}
    seen, found = _Window(_features(artefacts, states, seed)), dict[Pair, tuple[str, bool]]()
    for first in range(0, frames, TOGETHER):
        firsts = [a for a in range(first, min(first + TOGETHER, frames)) if a in pairs]
        seen.hold(first, max((last[a] for a in firsts), default=first))
        of_group = {pair: _registration(*seen.of(pair), pair, seed) for a in firsts for pair in pairs[a]}
        if of_group:
            artefacts.put(key := f"pairs/{first:06}", {"found": {tuple(map(_key, p)): r for p, r in of_group.items()}})
            found |= {pair: (key, not isinstance(one, str)) for pair, one in of_group.items()}
    numbered = [NumberedFrame(number, name(number), _key(number), NO_BORDER) for number in range(frames)]
    return ArchiveOfPoints(numbered, KnownPairs(found), poses)


def name(number: int) -> str:
    """A frame's name."""
    return f"{number:06}.jpg"


def _key(number: int) -> str:
    return f"points/{number:06}"


class _Window:
    """Of frames that come one after another, those that pairs need now."""

    def __init__(self, coming: Iterator[tuple[Features, Ids]]) -> None:
        self._coming = coming
        self._held: dict[int, tuple[Features, Ids]] = {}
        self._next = 0

    def hold(self, first: int, last: int) -> None:
        while self._next <= last:
            self._held[self._next] = next(self._coming)
            self._next += 1
        self._held = {number: one for number, one in self._held.items() if number >= first}

    def of(self, pair: Pair) -> list[tuple[Features, Ids]]:
        return [self._held[number] for number in pair]


def _features(artefacts: Artefacts, states: Sequence[CameraState], seed: int) -> Iterator[tuple[Features, Ids]]:
    """Features of each frame, put into the store, and the marks that they are of."""
    ground, rng = _Marks(seed), np.random.default_rng([seed, 3])
    for number, state in enumerate(states):
        places, ids = ground.around(state)
        pixels = pixels_from_ground(LENS, state, places) + rng.normal(0, NOISE_PX, places.shape)
        inside = ((pixels >= 0) & (pixels < [LENS.width, LENS.height])).all(axis=1) & (rng.random(len(ids)) < REPEATED)
        chosen = np.flatnonzero(inside)
        chosen = chosen[np.argsort(ids[chosen] * 0x9E3779B1 & 0xFFFFFFFF, kind="stable")][:SEEN]  # by strength
        none = np.empty((len(chosen), 0), np.uint8)
        found = Features(pixels[chosen].astype(np.float32), none, LENS.width, LENS.height, 1.0)
        artefacts.put(_key(number), {"summary": None, "places": found})
        yield found, ids[chosen]


class _Marks:
    """Marks on the plane, made cell by cell as they are seen."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._cells: dict[tuple[int, int], NDArray[np.float64]] = {}

    def around(self, state: CameraState) -> tuple[NDArray[np.float64], Ids]:
        """Places (m, 2) in metres of the marks around what a frame sees, and their numbers."""
        corners = np.array([[0, 0], [LENS.width, 0], [LENS.width, LENS.height], [0, LENS.height]], np.float64)
        outline = ground_from_pixels(LENS, state, corners)
        low, high = np.floor(outline.min(axis=0) / CELL).astype(int), np.floor(outline.max(axis=0) / CELL).astype(int)
        cells = [(x, y) for x in range(low[0], high[0] + 1) for y in range(low[1], high[1] + 1)]
        found = [self._cell(*cell, state.height) for cell in cells]
        firsts = [((x + 2**15) << 40) | ((y + 2**15) << 20) for x, y in cells]
        ids = [first + np.arange(len(some)) for first, some in zip(firsts, found, strict=True)]
        return np.concatenate(found), np.concatenate(ids)

    def _cell(self, x: int, y: int, height: float) -> NDArray[np.float64]:
        if (x, y) not in self._cells:
            rng = np.random.default_rng([self._seed, x + 2**15, y + 2**15])
            across, along = LENS.footprint(height)
            count = rng.poisson(SEEN / REPEATED * CELL**2 / (across * along))
            self._cells[x, y] = (rng.random((count, 2)) + np.array([x, y])) * CELL
        return self._cells[x, y]


def _registration(
    one: tuple[Features, Ids], other: tuple[Features, Ids], pair: Pair, seed: int
) -> StoredRegistration | str:
    """What matching two frames would have found."""
    (a, ids_a), (b, ids_b) = one, other
    _, in_a, in_b = np.intersect1d(ids_a, ids_b, assume_unique=True, return_indices=True)
    order = np.argsort(in_a)
    matches = np.stack([in_a[order], in_b[order]], axis=1)
    if len(matches) < FEWEST:
        return "no common homography"
    pixels_a, pixels_b = a.points[matches[:, 0]].astype(np.float64), b.points[matches[:, 1]].astype(np.float64)
    rng = np.random.default_rng([seed, *pair])
    wrong = rng.integers(0, [len(a), len(b)], (round(WRONG * len(matches)), 2))
    return StoredRegistration(
        features=matches.astype(np.uint16),
        tentative=np.concatenate([matches, wrong]).astype(np.uint16),
        displaced_a=np.empty((0, 2), np.float32),
        displaced_b=np.empty((0, 2), np.float32),
        b_from_a=cv2.findHomography(pixels_a, pixels_b, 0)[0],
        independent_inliers=independent_count(pixels_a, pixels_b, 16.0),
        evidence=EVIDENCE,
    )
