"""What an archive has joined, held against the truth: registrations, islands and second visits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels
from gcs_mosaic.stitch.graph.placement import Placement
from sitl.geometry import ground_from_pixels
from sitl.similarity import lengths, robust_similarity
from tests.benchmarks.look_alikes import LENS, Array, Taken, Visit, grid, number_of, seen_by

ASTRAY = 4.0  # pixels that the median of a registration's inliers may lie off: over rows a step to the next plant is 7
FAR = 8.0  # pixels that the median of a frame's places may lie off, after one similarity for its island

RIGHT, STRANGERS, APART, LAID_ASTRAY = "right", "of two lands", "without overlap", "astray"

Pair = tuple[int, int]


def judged(a: Taken, b: Taken, pixels_a: Array, pixels_b: Array) -> str:
    """What a registration is that takes these pixels (n, 2) of two frames for the same spots."""
    if a.land != b.land:
        return STRANGERS
    if not overlap(a, b):
        return APART
    off = lengths(seen_by(b.state, a.state, pixels_a) - pixels_b)
    return RIGHT if np.median(off) <= ASTRAY else LAID_ASTRAY


def overlap(a: Taken, b: Taken) -> bool:
    """Whether two frames of one land show any ground together."""
    there = seen_by(b.state, a.state, grid())
    return bool(((there >= 0) & (there <= [LENS.width - 1, LENS.height - 1])).all(axis=1).any())


@dataclass(frozen=True, slots=True)
class FoundIsland:
    """An island of the archive. lands: its frames by land; far: those of its main land that lie elsewhere than they were taken;
    false_links: pairs by which it hangs together and that are no right ones."""

    lands: Counter[int]
    far: tuple[int, ...]
    false_links: tuple[Pair, ...]

    @property
    def strangers(self) -> int:
        """Frames of other lands than that of most."""
        return self.lands.total() - max(self.lands.values())

    @property
    def is_false(self) -> bool:
        return bool(self.strangers or self.far)


def found_islands(
    placements: Iterable[Placement], truth: Sequence[Taken], kinds: Mapping[Pair, str]
) -> list[FoundIsland]:
    """All islands; `kinds`: what each registration is, by its frames' numbers."""
    of_island: dict[int, list[Placement]] = {}
    for placement in placements:
        of_island.setdefault(placement.island, []).append(placement)
    return [_found(some, truth, kinds) for some in of_island.values()]


def _found(placements: Sequence[Placement], truth: Sequence[Taken], kinds: Mapping[Pair, str]) -> FoundIsland:
    lands = Counter(truth[number_of(one.name)].land for one in placements)
    main = lands.most_common(1)[0][0]
    own = [one for one in placements if truth[number_of(one.name)].land == main]
    off = distances(own, truth)
    far = tuple(number_of(one.name) for one, distance in zip(own, off, strict=True) if not distance <= FAR)
    links = {_pair(one.name, other) for one in placements for other in one.neighbours}
    return FoundIsland(lands, far, tuple(sorted(pair for pair in links if kinds.get(pair, RIGHT) != RIGHT)))


def _pair(one: str, other: str) -> Pair:
    a, b = sorted(map(number_of, (one, other)))
    return a, b


def distances(placements: Sequence[Placement], truth: Sequence[Taken]) -> list[float]:
    """How far each frame of an island lies from where it was taken, after one similarity: median over it, in its own pixels."""
    if len(placements) < 2:
        return [0.0] * len(placements)
    canvas = [canvas_from_pixels(one.pose, one.camera, grid()) for one in placements]
    states = [truth[number_of(one.name)].state for one in placements]
    ground = [np.asarray(ground_from_pixels(LENS, state, grid()), np.float64) for state in states]
    known = np.isfinite(np.concatenate(canvas)).all(axis=1)
    similarity = robust_similarity(np.concatenate(canvas)[known], np.concatenate(ground)[known])
    off = [lengths(c @ similarity[:2, :2].T + similarity[:2, 2] - g) for c, g in zip(canvas, ground, strict=True)]
    return [
        float(np.median(np.nan_to_num(some, nan=np.inf))) / (state.height / LENS.focal_px)
        for some, state in zip(off, states, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class Return:
    """A second visit: its frames that are placed, and those on an island with frames of the first; pairs of frames of both visits
    that were compared, and rightly registered."""

    visit: Visit
    placed: int
    joined: int
    compared: int
    registered: int


def returns(
    placements: Iterable[Placement], truth: Sequence[Taken], compared: Iterable[Pair], kinds: Mapping[Pair, str]
) -> list[Return]:
    """What became of each second visit."""
    islands: dict[Visit, Counter[int]] = {}
    for one in placements:
        islands.setdefault(truth[number_of(one.name)].visit, Counter())[one.island] += 1
    across = Counter(truth[b].visit for a, b in compared if _come_back(truth[a], truth[b]))
    right = Counter(
        truth[b].visit for (a, b), kind in kinds.items() if kind == RIGHT and _come_back(truth[a], truth[b])
    )
    firsts = {one.visit.land: one.visit for one in truth if one.visit.later is None}
    return [
        Return(
            visit, own.total(), _shared(own, islands.get(firsts[visit.land], Counter())), across[visit], right[visit]
        )
        for visit, own in ((visit, islands.get(visit, Counter())) for visit in _second(truth))
    ]


def _second(truth: Sequence[Taken]) -> Iterator[Visit]:
    return iter(dict.fromkeys(one.visit for one in truth if one.visit.later))


def _come_back(a: Taken, b: Taken) -> bool:
    """Whether b is of a second visit, and a of the first to the same land."""
    return a.land == b.land and a.visit.later is None and b.visit.later is not None


def _shared(own: Counter[int], first: Counter[int]) -> int:
    return sum(count for island, count in own.items() if island in first)
