"""Things that only one look each shows, linked to tracks: what goes on at about the same speed, and looks alike, is one thing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

LEAST_LOOKS = 3  # two places are joined by a straight line whatever they are; the third says that it is a way
FARTHEST = 12.0  # times its own size that a thing goes between two looks: a person runs at 4 m/s, a car at 50 km/h
LEAST_WAY = 1.0  # times its own size between two looks; what moves less is shown by both at the same ground
ASIDE, OF_STEP = 1.5, 0.35  # sizes, and share of the last step, by which it may miss where it was to be
ALIKE_SIZE, ALIKE_CONTRAST = 2.0, 2.0  # times


@dataclass(frozen=True, slots=True)
class SeenBlob:
    """A thing in one frame. `turn`: the frame's place in the order of looks; `x`, `y`, `size` in canvas units; `time`: seconds,
    by one clock for all, or the turn where none is known; `frame` and `pixel` (of the original): where it is looked at."""

    turn: int
    time: float
    x: float
    y: float
    size: float
    contrast: float
    frame: int
    pixel: tuple[float, float]


def tracks_of(seen: Sequence[SeenBlob]) -> list[list[SeenBlob]]:
    """Tracks of LEAST_LOOKS things or more, each thing in one of them at most; the longest, then the straightest, first."""
    turns = _Turns(seen)
    begun = sorted(_beginnings(seen, turns), key=lambda found: found[0])
    taken = set[int]()
    tracks = []
    for _, three in begun:
        if taken & {id(one) for one in three}:
            continue
        track = _continued(list(three), turns, taken, 1)
        track = _continued(track[::-1], turns, taken, -1)[::-1]
        taken |= {id(one) for one in track}
        tracks.append(track)
    return sorted(tracks, key=lambda track: -len(track))


class _Turns:
    """Things by the turn in which they were seen."""

    def __init__(self, seen: Sequence[SeenBlob]) -> None:
        self._things: dict[int, list[SeenBlob]] = {}
        for one in seen:
            self._things.setdefault(one.turn, []).append(one)
        self._facts = {
            turn: np.array([(one.x, one.y, one.size, one.contrast) for one in things]).T
            for turn, things in self._things.items()
        }
        self._beside: dict[tuple[int, int], list[SeenBlob]] = {}

    def beside(self, one: SeenBlob, step: int) -> list[SeenBlob]:
        """What may be the same thing in the look after one (a step of 1), or before it (-1)."""
        key = id(one), step
        if key not in self._beside:
            self._beside[key] = self._sought(one, one.turn + step)
        return self._beside[key]

    def _sought(self, one: SeenBlob, turn: int) -> list[SeenBlob]:
        if turn not in self._things:
            return []
        x, y, sizes, contrasts = self._facts[turn]
        size, smaller = np.maximum(sizes, one.size), np.minimum(sizes, one.size)
        way = np.hypot(x - one.x, y - one.y)
        strong, weak = (of(np.abs(contrasts), abs(one.contrast)) for of in (np.maximum, np.minimum))
        is_alike = (contrasts * one.contrast > 0) & (size <= ALIKE_SIZE * smaller) & (strong <= ALIKE_CONTRAST * weak)
        may_be = is_alike & (LEAST_WAY * size < way) & (way < FARTHEST * size)
        return [self._things[turn][index] for index in np.flatnonzero(may_be)]


def _beginnings(seen: Sequence[SeenBlob], turns: _Turns) -> Iterator[tuple[float, tuple[SeenBlob, SeenBlob, SeenBlob]]]:
    """Three in a row that may be one thing, and by how much they miss an even way (times what is allowed)."""
    for first in seen:
        for second in turns.beside(first, 1):
            for third in turns.beside(second, 1):
                if (missed := _missed(first, second, third)) < 1:
                    yield missed, (first, second, third)


def _continued(track: list[SeenBlob], turns: _Turns, taken: set[int], step: int) -> list[SeenBlob]:
    """A track with what comes after its end; by a step of -1, of one that is turned round, before it."""
    while True:
        *_, before, last = track
        nexts = [one for one in turns.beside(last, step) if id(one) not in taken]
        best = min(nexts, key=lambda one: _missed(before, last, one), default=None)
        if best is None or _missed(before, last, best) >= 1:
            return track
        track.append(best)


def _missed(first: SeenBlob, second: SeenBlob, third: SeenBlob) -> float:
    """How far from where it was to be at an even speed, times what is allowed."""
    step_x, step_y = second.x - first.x, second.y - first.y
    ratio = abs(third.time - second.time) / max(abs(second.time - first.time), 1e-6)
    times = min(max(ratio, 0.2), 5.0)
    allowed = ASIDE * max(first.size, second.size, third.size) + OF_STEP * math.hypot(step_x, step_y)
    return math.hypot(third.x - second.x - times * step_x, third.y - second.y - times * step_y) / allowed
