"""An archive without pictures: what its frames and pairs would have brought is put into a store as its tasks find it there.

A flat ground full of marks; each frame sees half of those in its view, with noise, the strongest 2,000. Two frames have matched
what both have seen, and some of what they have not. About what caliterra's frames bring (2,000 features, 10 pairs a frame,
390 inliers a pair; caliterra 450). No descriptors: nothing after the registrations reads them.

The ground is the same again in every BLOCK frames, and so is the flight: what a block's frames and pairs have brought serves all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.look_up import NumberedFrame
from gcs_mosaic.archive.pairs import KnownPairs, Pair, StoredRegistration
from gcs_mosaic.stitch.arrays import PosesNx6
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.frame_pair import independent_count
from sitl.geometry import CameraState, ground_from_pixels, pixels_from_ground
from sitl.path import fly
from tests.benchmarks.flight_of_points import HEIGHT, LENS, NOISE_PX, plan
from tests.benchmarks.survey_of_matches import canvas_pose, linked

SEEN = 2000  # features of a frame at most
REPEATED = 0.55  # share of the marks in view that a frame sees
BLOCK = 3000  # frames
PAIRED = 20  # frames that one is compared with, at most: 10 pairs a frame
WRONG = 0.08  # matches that are none, for each one that is
FEWEST = 20  # common marks from which a pair is registered
LINE = 20.0  # metres at least from the last line of a block to the first of the next
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
    block = min(frames, BLOCK)
    states = list(fly("survey", LENS, replace(plan(block), climbs=0)))[:block]
    poses = np.array([canvas_pose(state) for state in states])
    cells = math.ceil((np.ptp([state.x for state in states]) + LINE) / CELL)
    shift = np.array([cells * CELL * LENS.focal_px / HEIGHT, 0.0, 0.0, 0.0, 0.0, 0.0])
    seen = list(_features(artefacts, states, _Marks(seed, cells), seed))
    pairs = linked(np.concatenate([poses, poses + shift]), PAIRED)  # of one block and the next
    pairs = pairs[pairs[:, 0] < block]
    keys = dict(_registrations(artefacts, pairs.tolist(), seen, seed))
    found = {
        (a + at, b + at): known for (a, b), known in keys.items() for at in range(0, frames, block) if b + at < frames
    }
    numbered = [NumberedFrame(number, name(number), _key(number % block), NO_BORDER) for number in range(frames)]
    whole = np.concatenate([poses + at * shift for at in range(-(-frames // block))])[:frames]
    return ArchiveOfPoints(numbered, KnownPairs(dict(sorted(found.items()))), whole)


def _registrations(
    artefacts: Artefacts, pairs: Sequence[Pair], seen: Sequence[tuple[Features, Ids]], seed: int
) -> Iterator[tuple[Pair, tuple[str, bool]]]:
    """By pair of a block's frames, or one of the next, the artefact that holds its registration, and whether it is one."""
    for first, group in groupby(pairs, lambda pair: pair[0] // TOGETHER):
        some = [(a, b) for a, b in group]
        found = {(a, b): _registration(seen[a], seen[b % len(seen)], (a, b), seed) for a, b in some}
        artefacts.put(
            key := f"pairs/{first:06}",
            {"found": {tuple(_key(number % len(seen)) for number in pair): one for pair, one in found.items()}},
        )
        yield from ((pair, (key, not isinstance(one, str))) for pair, one in found.items())


def name(number: int) -> str:
    """A frame's name."""
    return f"{number:06}.jpg"


def _key(number: int) -> str:
    return f"points/{number:06}"


def _features(
    artefacts: Artefacts, states: Sequence[CameraState], ground: _Marks, seed: int
) -> Iterator[tuple[Features, Ids]]:
    """Features of each frame, put into the store, and the marks that they are of."""
    rng = np.random.default_rng([seed, 3])
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
    """Marks on the plane, made cell by cell as they are seen; after so many cells to the east it is the same again."""

    def __init__(self, seed: int, cells: int) -> None:
        self._seed = seed
        self._until_again = cells
        self._cells: dict[tuple[int, int], NDArray[np.float64]] = {}

    def around(self, state: CameraState) -> tuple[NDArray[np.float64], Ids]:
        """Places (m, 2) in metres of the marks around what a frame sees, and their numbers."""
        corners = np.array([[0, 0], [LENS.width, 0], [LENS.width, LENS.height], [0, LENS.height]], np.float64)
        outline = ground_from_pixels(LENS, state, corners)
        low, high = np.floor(outline.min(axis=0) / CELL).astype(int), np.floor(outline.max(axis=0) / CELL).astype(int)
        cells = [(x, y) for x in range(low[0], high[0] + 1) for y in range(low[1], high[1] + 1)]
        found = [self._cell(*cell, state.height) for cell in cells]
        firsts = [(x % self._until_again << 40) | (y + 2**15 << 20) for x, y in cells]
        ids = [first + np.arange(len(some)) for first, some in zip(firsts, found, strict=True)]
        return np.concatenate(found), np.concatenate(ids)

    def _cell(self, x: int, y: int, height: float) -> NDArray[np.float64]:
        own = x % self._until_again, y
        if own not in self._cells:
            rng = np.random.default_rng([self._seed, own[0], y + 2**15])
            across, along = LENS.footprint(height)
            count = rng.poisson(SEEN / REPEATED * CELL**2 / (across * along))
            self._cells[own] = rng.random((count, 2)) * CELL
        return self._cells[own] + np.array([x, y]) * CELL


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
    nothing = np.empty((0, 2), np.float32)
    return StoredRegistration(
        features=matches.astype(np.uint16),
        tentative=np.concatenate([matches, wrong]).astype(np.uint16),
        patches_a=nothing,
        patches_b=nothing,
        displaced_a=nothing,
        displaced_b=nothing,
        b_from_a=np.asarray(cv2.findHomography(pixels_a, pixels_b, 0)[0], np.float64),
        independent_inliers=independent_count(pixels_a, pixels_b, 16.0),
        evidence=EVIDENCE,
        beyond=0.0,
    )
