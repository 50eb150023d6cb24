"""Stage 6: frames are placed one after another and islands joined, as in a flight, but each comparison is looked up.

The one serial stage beside the adjustment: it computes with points and matches alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, places_of
from gcs_mosaic.archive.kinds import FrameKind
from gcs_mosaic.archive.pairs import KnownPairs, Pair
from gcs_mosaic.archive.retrieval import Described
from gcs_mosaic.archive.tasks import Parts, listed, task
from gcs_mosaic.stitch.arrays import Mask
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings, View
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import Covered, Placement, Rejection
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.registration.registration import (
    MatchPart,
    NotRegistered,
    Registration,
    RegistrationSettings,
    borne_out,
)

GROUPS_KEPT = 512  # of pairs, 250 kB each
NEVER = NotRegistered("never compared", 0, np.empty((0, 2)), np.empty((0, 2)))


@dataclass(frozen=True, slots=True)
class Assembled:
    """What became of the frames, and where the adjustments that are to follow lie: `tasks` are the islands' numbers, parts of
    the artefact `key`. `islands`: by number, the island that each was merged into."""

    key: str
    islands: tuple[int | None, ...]
    tasks: tuple[tuple[int, int], ...]  # an island and its number of frames
    placed: dict[str, int]  # the island of each placed frame
    covered: tuple[Covered, ...]
    rejected: tuple[Rejection, ...]


def assembled(
    engine: Engine, frames: Sequence[SeenFrame], kinds: Sequence[FrameKind], known: KnownPairs, settings: StitchSettings
) -> Assembled:
    """All frames in their order."""
    described = [(one.frame.name, one.key, kind.dead_as_taken) for one, kind in zip(frames, kinds, strict=True)]
    pairs = sorted(known.found.items())
    one = task(islands, listed(engine.artefacts, described), listed(engine.artefacts, pairs), settings)
    merged, tasks, placed, covered, rejected = engine.made("islands", [one])[0]
    return Assembled(one.key, merged, tasks, placed, covered, rejected)


def islands(artefacts: Artefacts, frames: str, pairs: str, settings: StitchSettings) -> Parts:
    """Place all frames; the islands' joint adjustments are left to the next stage."""
    described = artefacts.part(frames, "list")
    known = PairBook(artefacts, described, KnownPairs(dict(artefacts.part(pairs, "list"))))
    mosaic = Mosaic(without_relief(settings), search=partial(LookUp, known), punctual=True)
    rejected = []
    for name, key, dead in described:
        outcome = mosaic.place(places_of(artefacts, key, dead), name)
        mosaic.adjust()
        rejected += [outcome] if isinstance(outcome, Rejection) else []
    mosaic.retry_waiting()
    while mosaic.connect_some():
        mosaic.adjust()
    mosaic.retry_waiting()
    tasks = {task.island: replace(task, settings=settings.adjustment) for task in mosaic.adjustments()}
    summary = (
        tuple(island.merged_into for island in mosaic.islands),
        tuple((number, len(task.members)) for number, task in tasks.items()),
        {placement.name: placement.island for placement in mosaic.placements()},
        tuple(mosaic.covered()),
        (*rejected, *mosaic.finish()),
    )
    of_islands: dict[int, list[Placement]] = {}
    for placement in mosaic.placements():
        of_islands.setdefault(placement.island, []).append(placement)
    parts = {f"placements {number}": found for number, found in of_islands.items()}
    return {"summary": summary, **parts, **{f"adjustment {number}": task for number, task in tasks.items()}}


def without_relief(settings: StitchSettings) -> StitchSettings:
    """The same, but sheets of relief are not fitted: no place depends on them, and they are fitted in parallel later."""
    adjustment = settings.adjustment
    relief = replace(adjustment.relief, cells=0)
    return replace(settings, adjustment=replace(adjustment, relief=relief))


class PairBook:
    """Registrations by the frames' numbers in the archive, read when they are asked for."""

    def __init__(self, artefacts: Artefacts, described: Sequence[tuple[str, *Described]], known: KnownPairs) -> None:
        self._numbers = {name: number for number, (name, *_) in enumerate(described)}
        self._features = [key for _, key, _ in described]
        self._keys = {pair: key for pair, (key, _) in known.found.items()}
        self._group = lru_cache(GROUPS_KEPT)(lambda key: artefacts.part(key, "found"))
        self._others = known.others()

    def knows(self, one: str, other: str) -> bool:
        """Whether two frames were compared."""
        return self._pair(one, other) in self._keys

    def others(self, name: str) -> dict[int, bool]:
        """The frames of the archive that one was compared with, and whether they were registered."""
        return self._others.get(self._numbers[name], {})

    def number(self, name: str) -> int:
        return self._numbers[name]

    def found(self, a: str, b: str, of_a: Features, of_b: Features) -> Registration | NotRegistered:
        """The registration of frame a with frame b."""
        pair = self._pair(a, b)
        if pair not in self._keys:
            return NEVER
        stored = self._group(self._keys[pair])[tuple(self._features[number] for number in pair)]
        if isinstance(stored, str):
            return replace(NEVER, reason=stored)
        if pair[0] == self._numbers[a]:
            return stored.whole(of_a, of_b)  # type: ignore[no-any-return]
        turned: Registration = stored.whole(of_b, of_a).turned()
        return turned

    def _pair(self, one: str, other: str) -> Pair:
        numbers = self._numbers[one], self._numbers[other]
        return min(numbers), max(numbers)


class LookUp(Search):
    """A search that compares nothing: what is alike and how frames lie to each other is looked up."""

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

    def likeliest(self, frame: int, among: ArrayLike, count: int | None = None) -> list[int]:
        known, frames = self._known.others(self._name(frame)), self._graph.frames
        own = self._known.number(self._name(frame))
        others = [int(o) for o in np.asarray(among, np.intp).tolist() if o != frame]
        numbers = {other: self._known.number(frames[other].name) for other in others}
        alike = [other for other in others if numbers[other] in known]
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
