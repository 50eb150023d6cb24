"""Comparisons that were made before, looked up: what placing a frame asks of a search."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike

from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.features import places_of, whole_features
from gcs_mosaic.archive.pairs import KnownPairs, Pair, StoredRegistration
from gcs_mosaic.stitch.arrays import Mask, Points32Nx2
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Pose, View
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.confirmation import borne_out
from gcs_mosaic.stitch.registration.frame_pair import MatchPart
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

WITNESSES = 6  # frames around a place that one pair of frames tells
GROUPS_KEPT = 512  # of pairs, 250 kB each
POINTS_KEPT = 1024  # frames, 16 kB each
NEVER = NotRegistered("never compared", 0, np.empty((0, 2)), np.empty((0, 2)))


@dataclass(frozen=True, slots=True)
class NumberedFrame:
    """A frame of the archive by its number; `key`: its features; `dead`: their dead border; `folder`: the number of that in which
    it lay, whose frames of one size were taken by one camera."""

    number: int
    name: str
    key: str
    dead: DeadBorder
    folder: int = 0


@dataclass(frozen=True, slots=True)
class StoredPoints:
    """The places (n, 2) of a frame's features, which are read when they are asked for."""

    shape: tuple[int, int]
    number: int
    read: Callable[[int], Points32Nx2]

    def array(self) -> Points32Nx2:
        return self.read(self.number)

    def exact(self) -> Points32Nx2:
        return self.read(self.number)


class PairBook:
    """Registrations and places of features by the frames' numbers in the archive, read when they are asked for."""

    def __init__(self, artefacts: Artefacts, frames: Iterable[NumberedFrame], known: KnownPairs) -> None:
        self._frames = {one.number: one for one in frames}
        self._numbers = {one.name: one.number for one in self._frames.values()}
        self._keys = {pair: key for pair, (key, _) in known.found.items()}
        self._group = lru_cache(GROUPS_KEPT)(lambda key: artefacts.part(key, "found"))
        self._points = lru_cache(POINTS_KEPT)(partial(_points_of, artefacts, self._frames))
        self._others = known.others()
        self._artefacts = artefacts
        self._lost: Lost | None = None

    def knows(self, one: str, other: str) -> bool:
        """Whether two frames were compared."""
        return self._pair(one, other) in self._keys

    def registered(self, one: str, other: str) -> bool:
        """Whether two frames were compared, and registered."""
        return self._others.get(self._numbers[one], {}).get(self._numbers[other], False)

    def others(self, name: str) -> dict[int, bool]:
        """The frames of the archive that one was compared with, and whether they were registered."""
        return self._others.get(self._numbers[name], {})

    def number(self, name: str) -> int:
        return self._numbers[name]

    def name(self, number: int) -> str:
        return self._frames[number].name

    def found(self, a: str, b: str, of_a: Features, of_b: Features) -> Registration | NotRegistered:
        """The registration of frame a with frame b."""
        pair = self._pair(a, b)
        if pair not in self._keys:
            return NEVER
        stored = self._read(self._keys[pair])[tuple(self._frames[number].key for number in pair)]
        if isinstance(stored, str):
            return replace(NEVER, reason=stored)
        if pair[0] == self._numbers[a]:
            return stored.whole(of_a, of_b)
        return stored.whole(of_b, of_a).turned()

    def features(self, name: str) -> Features:
        """All features of a frame, with descriptors."""
        frame = self.frame(name)
        with self._noting_what_is_lost():
            return whole_features(self._artefacts, frame.key, frame.dead)

    def points(self, name: str, count: int) -> StoredPoints:
        """The places of so many features of a frame."""
        return StoredPoints((count, 2), self._numbers[name], self._points_of)

    def frame(self, name: str) -> NumberedFrame:
        return self._frames[self._numbers[name]]

    def key(self, one: str, other: str) -> tuple[Pair, str]:
        """Two frames that were compared, and the artefact that holds their registration."""
        return (pair := self._pair(one, other)), self._keys[pair]

    def _read(self, key: str) -> dict[tuple[str, ...], StoredRegistration | str]:
        with self._noting_what_is_lost():
            return self._group(key)  # type: ignore[no-any-return]

    def _points_of(self, number: int) -> Points32Nx2:
        with self._noting_what_is_lost():
            return self._points(number)

    @contextmanager
    def _noting_what_is_lost(self) -> Iterator[None]:
        try:
            yield
        except Lost as error:
            self._lost = error
            raise

    def check(self) -> None:
        """Raises Lost if any registration that was asked for was not there, whatever became of that."""
        if self._lost is not None:
            raise self._lost

    def _pair(self, one: str, other: str) -> Pair:
        numbers = self._numbers[one], self._numbers[other]
        return min(numbers), max(numbers)


def _points_of(artefacts: Artefacts, frames: Mapping[int, NumberedFrame], number: int) -> Points32Nx2:
    one = frames[number]
    return places_of(artefacts, one.key, one.dead).points


class LookUp(Search):
    """A search that looks up what is alike and how frames lie to each other, and compares only what could refute that."""

    def __init__(
        self,
        known: PairBook,
        graph: ViewGraph,
        settings: SearchSettings,
        registration: RegistrationSettings,
        observer: Observer | None = None,
    ) -> None:
        super().__init__(graph, settings, registration, observer)
        self._known = known
        self._thorough = Comparing(known, graph, settings, registration, observer)

    def likeliest(self, frame: int, among: ArrayLike, count: int | None = None) -> list[int]:
        known, own = self._known.others(self._name(frame)), self._known.number(self._name(frame))
        found = ((self._graph.numbers.get(self._known.name(number)), number) for number in known)
        numbers = {other: number for other, number in found if other is not None}
        others = np.array(list(numbers), np.intp)
        alike: list[int] = others[np.isin(others, among)].tolist()
        alike.sort(key=lambda other: (not known[numbers[other]], abs(numbers[other] - own), other))
        return alike[: self._settings.wide_tries if count is None else count]

    def register(self, frame: int, other: int) -> Registration | None:
        part, of_other = (MatchPart(again=self._graph.matched_before(f)) for f in (frame, other))
        return self._told(frame, other, self._looked_up(frame, other, part, of_other))

    def compare(self, name: str, features: Features, other: int) -> Registration | None:
        placed = self._graph.frames[other]
        found = self._known.found(name, placed.name, features, placed.features)
        if isinstance(found, Registration):
            part = MatchPart(again=self._graph.matched_before(other))
            found = borne_out(found, features, placed.features, self._registration, MatchPart(), part)
        return self._told_of(name, other, found)

    @property
    def thorough(self) -> Search:
        return self._thorough

    def neighbour_links(
        self, frame: int, pose: Pose, island: int, most: int | None = None
    ) -> dict[int, Registration | None]:
        """Those that were looked up; where they bear the pose out by none, some are compared, which may refute it."""
        known = super().neighbour_links(frame, pose, island, most)
        if any(known.values()):
            return known
        return known | self._thorough.neighbour_links(frame, pose, island, WITNESSES)

    def pixels_bear_out(self, frame: int, pose: Pose, island: int, links: Mapping[int, Registration | None]) -> float:
        """By the frames' pictures, which are read for it."""
        return self._thorough.pixels_bear_out(frame, pose, island, links)

    def _overlapping(self, frame: int, *view: object) -> list[int]:
        """Only frames that were compared: nothing can be said of the others."""
        others = super()._overlapping(frame, *view)  # type: ignore[arg-type]
        return [other for other in others if self._known.knows(self._name(frame), self._name(other))]

    def _registered_in_place(self, frame: int, view_a: View, again: Mask, other: int) -> Registration | NotRegistered:
        part_b = MatchPart(again=self._graph.matched_before(other))
        return self._looked_up(frame, other, MatchPart(again=again), part_b)

    def _looked_up(
        self, frame: int, other: int, part: MatchPart, part_of_other: MatchPart
    ) -> Registration | NotRegistered:
        (a, b), (name, of_other) = (
            (self._graph.frames[f].features for f in (frame, other)),
            map(self._name, (frame, other)),
        )
        found = self._known.found(name, of_other, a, b)
        if isinstance(found, NotRegistered):
            return found
        return borne_out(found, a, b, self._registration, part, part_of_other)

    def _name(self, frame: int) -> str:
        return self._graph.frames[frame].name


class Comparing(Search):
    """A search around a place that compares what was never compared, or not registered without knowing the place."""

    def __init__(
        self,
        known: PairBook,
        graph: ViewGraph,
        settings: SearchSettings,
        registration: RegistrationSettings,
        observer: Observer | None = None,
    ) -> None:
        super().__init__(graph, settings, registration, observer)
        self._known = known

    def _features_of(self, frame: int) -> Features:
        return self._known.features(self._graph.frames[frame].name)
