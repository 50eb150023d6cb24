"""Things that only one look each shows, linked to tracks: what goes on at about the same speed, and looks alike, is one thing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

LEAST_LOOKS = 3  # two places are joined by a straight line whatever they are; the third says that it is a way
FARTHEST = 12.0  # times its own size that a thing goes between two looks: a person runs at 4 m/s, a car at 50 km/h
LEAST_WAY = 1.0  # times its own size between two looks; what moves less is shown by both at the same ground
ASIDE, OF_STEP = 1.5, 0.35  # sizes, and share of the last step, by which it may miss where it was to be
ALIKE_SIZE, ALIKE_CONTRAST = 2.0, 2.0  # times


@dataclass(frozen=True, slots=True)
class Seen:
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


def tracks_of(seen: Sequence[Seen]) -> list[list[Seen]]:
    """Tracks of LEAST_LOOKS things or more, each thing in one of them at most; the longest, then the straightest, first."""
    turns: dict[int, list[Seen]] = {}
    for one in seen:
        turns.setdefault(one.turn, []).append(one)
    begun = sorted(_beginnings(turns), key=lambda found: found[0])
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


def _beginnings(turns: dict[int, list[Seen]]) -> Iterator[tuple[float, tuple[Seen, Seen, Seen]]]:
    """Three in a row that may be one thing, and by how much they miss an even way (times what is allowed)."""
    for turn, firsts in turns.items():
        for first in firsts:
            for second in turns.get(turn + 1, ()):
                if not _may_follow(first, second):
                    continue
                for third in turns.get(turn + 2, ()):
                    if _may_follow(second, third) and (missed := _missed(first, second, third)) < 1:
                        yield missed, (first, second, third)


def _continued(track: list[Seen], turns: dict[int, list[Seen]], taken: set[int], step: int) -> list[Seen]:
    """A track with what comes after its end; by a step of -1, of one that is turned round, before it."""
    while True:
        *_, before, last = track
        nexts = [one for one in turns.get(last.turn + step, ()) if id(one) not in taken and _may_follow(last, one)]
        best = min(nexts, key=lambda one: _missed(before, last, one), default=None)
        if best is None or _missed(before, last, best) >= 1:
            return track
        track.append(best)


def _may_follow(one: Seen, other: Seen) -> bool:
    size = max(one.size, other.size)
    way = np.hypot(other.x - one.x, other.y - one.y)
    is_alike = one.contrast * other.contrast > 0 and size <= ALIKE_SIZE * min(one.size, other.size)
    strength = sorted((abs(one.contrast), abs(other.contrast)))
    return bool(is_alike and strength[1] <= ALIKE_CONTRAST * strength[0] and LEAST_WAY * size < way < FARTHEST * size)


def _missed(first: Seen, second: Seen, third: Seen) -> float:
    """How far from where it was to be at an even speed, times what is allowed."""
    step = np.array([second.x - first.x, second.y - first.y])
    ratio = abs(third.time - second.time) / max(abs(second.time - first.time), 1e-6)
    to_be = np.array([second.x, second.y]) + np.clip(ratio, 0.2, 5.0) * step
    allowed = ASIDE * max(first.size, second.size, third.size) + OF_STEP * np.hypot(*step)
    return float(np.hypot(third.x - to_be[0], third.y - to_be[1]) / allowed)
