"""A second look, in pauses and at the end, at frames that would be lost: at a finer picture with three times the features.

Over woods 1.8 megapixels with 6,000 features have twice the inliers of 0.75 with 2,000, at ten times the cost. So only frames
that nothing else connects are looked at so: one that waits, beside its like, and the last of a small island beside the next; of
all that in vain no more than a share of the flight.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, with_overlay, within, without_border
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, ViewGraph
from gcs_mosaic.stitch.registration.outcome import NO_MATCHES, Registration

Pair = tuple[int, int]
Finer = Callable[[str], Features | None]  # the features of a frame at a finer picture; None if its picture is gone

HELD = 4  # frames whose finer features are held: pairs of frames that follow each other share one


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondLookSettings:
    """What may be looked at a second time, and at what."""

    megapixels: float = 1.8  # size of the picture; 0: no frame is looked at a second time
    count: int = 6000  # features kept, the strongest
    # frames of an island up to which it is worth while to look whether it belongs to the next
    small_island: int = 10
    # pairs of frames that may be looked at in vain: so many,
    in_vain: int = 4
    # and so many more per frame of the flight; each costs about two seconds
    in_vain_per_frame: float = 0.1

    def features(self, first: FeatureSettings) -> FeatureSettings:
        """How features are found at a second look. What a model finds depends on no size."""
        return replace(
            first, megapixels=max(self.megapixels, first.megapixels), count=max(self.count, first.count), model=None
        )


class SecondLook:
    """Which frames of a graph are looked at a second time, and what is seen. `are_apart`: whether two are not connected yet."""

    def __init__(
        self,
        graph: ViewGraph,
        search: Search,
        settings: SecondLookSettings,
        are_apart: Callable[[int, int], bool],
        finer: Finer | None = None,
    ) -> None:
        self._graph, self._search, self._settings = graph, search, settings
        self._are_apart, self._finer = are_apart, finer
        self._held = OrderedDict[str, Features | None]()
        self._none_left: Hashable = None  # while no more is known than this, no pair is left

    def next_pair(self, known: Hashable) -> Pair | None:
        """The next two frames to look at; None if there are none, or too many were looked at in vain. `known`: changes whenever
        there may be others."""
        if self._finer is None or not self._settings.megapixels or self._none_left == known:
            return None
        if self._in_vain() < self._most_in_vain:
            for pair in self._apart():
                if pair not in self._graph.looked_again:
                    return pair
        self._none_left = known
        return None

    def is_ready(self, pair: Pair) -> bool:
        """Whether the pictures of both were searched for features; else one is now, which takes a second."""
        missing = next((frame for frame in pair if self._name(frame) not in self._held), None)
        if missing is None:
            return True
        self._held[self._name(missing)] = None  # also if it raises: it is not tried again
        while len(self._held) > HELD:
            self._held.popitem(last=False)
        self._held[self._name(missing)] = self._features(missing)
        return False

    def register(self, frame: int, other: int) -> Registration | None:
        """What is seen of two frames that are ready. Its matches are of features that the graph does not know, so they count as
        places that both frames show."""
        a, b = (self._held.get(self._name(one)) for one in (frame, other))
        found = None if a is None or b is None else self._search.register_as(frame, a, other, b)
        return found and replace(found, features=NO_MATCHES, tentative=NO_MATCHES)

    def _name(self, frame: int) -> str:
        return self._graph.frames[frame].name

    def _features(self, frame: int) -> Features | None:
        assert self._finer is not None, "without it nothing is looked at again"
        known = self._graph.frames[frame]
        found = self._finer(known.name)
        if found is None or (found.width, found.height) != (known.features.width, known.features.height):
            return None
        found = within(without_border(found, known.features.dead), known.features.area)
        return found if known.features.still is None else with_overlay(found, known.features.still)

    @property
    def _most_in_vain(self) -> float:
        return self._settings.in_vain + self._settings.in_vain_per_frame * len(self._graph.frames)

    def _in_vain(self) -> int:
        return sum(self._are_apart(*pair) for pair in self._graph.looked_again)

    def _apart(self) -> Iterator[Pair]:
        """Frames that are not connected: each that waits with those before and after it and with the one most like it, then those
        that follow each other on two islands, of which one is small."""
        waiting, placed, count = self._graph.waiting, self._graph.placed(), len(self._graph.frames)
        for frame in waiting:
            beside = [other for other in (frame - 1, frame + 1) if 0 <= other < count]
            for other in (*beside, *self._search.likeliest(frame, placed, 1)):
                if self._are_apart(frame, other):
                    yield pair_of(frame, other)
        islands = self._graph.islands
        breaks = (islands[:-1] != islands[1:]) & (islands[:-1] != NOWHERE) & (islands[1:] != NOWHERE)
        for frame in np.flatnonzero(breaks).tolist():
            sizes = [self._graph.count_members(int(island)) for island in islands[frame : frame + 2]]
            if min(sizes) <= self._settings.small_island:
                yield frame, frame + 1


def pair_of(frame: int, other: int) -> Pair:
    """Key of two frames, in either order."""
    return min(frame, other), max(frame, other)
