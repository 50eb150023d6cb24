"""Stage 6: stretches of frames are placed, each by itself, and then joined, some at a time, until a few are left.

Within a stretch frames are placed one after another and islands joined, as in a flight, but each comparison is looked up. That
costs more than all that follows, and there is a worker's task for each stretch. Joining moves whole islands, by pairs of frames
of two stretches, links all such pairs that agree with that, and adjusts the islands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import places_of
from gcs_mosaic.archive.look_up import LookUp, NumberedFrame, PairBook
from gcs_mosaic.archive.pairs import KnownPairs, Pair
from gcs_mosaic.archive.tasks import Parts, listed, task
from gcs_mosaic.stitch.graph.placement import Rejection
from gcs_mosaic.stitch.graph.union import Renamed
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

STRETCH = 512  # frames: a minute's work
JOINED = 4  # stretches that one task joins; then as many of what was joined
ROUNDS = 3  # of joining: what a few pairs have joined is bent until it is adjusted, and then more pairs agree
AS_THEY_ARE = Renamed(name_of=lambda name: name, aircraft_of=lambda aircraft: aircraft)

KnownPair = tuple[Pair, tuple[str, bool]]


@dataclass(frozen=True, slots=True)
class LeftToJoin:
    """Keys of what was placed, and where the list of pairs lies whose frames are not of one part."""

    parts: tuple[str, ...]
    pairs: str


def placed_stretches(
    engine: Engine, frames: Sequence[NumberedFrame], known: KnownPairs, settings: StitchSettings, length: int
) -> LeftToJoin:
    """All frames in their order, as at most JOINED parts."""
    of_one, left = _shared_out(sorted(known.found.items()), length)
    parts = [
        task(stretch, listed(engine.artefacts, frames[at : at + length]), _list(engine, of_one, at // length), settings)
        for at in range(0, len(frames), length)
    ]
    engine.made("stretches", parts)
    while len(parts) > JOINED:
        length *= JOINED
        of_one, left = _shared_out(left, length)
        groups = [tuple(one.key for one in parts[at : at + JOINED]) for at in range(0, len(parts), JOINED)]
        parts = [task(joined, group, _list(engine, of_one, at), settings) for at, group in enumerate(groups)]
        engine.made(f"joining, {length} frames", parts)
    return LeftToJoin(tuple(one.key for one in parts), listed(engine.artefacts, left))


def _shared_out(pairs: Sequence[KnownPair], length: int) -> tuple[dict[int, list[KnownPair]], list[KnownPair]]:
    """Pairs within each stretch of this length, and the others."""
    within, left = dict[int, list[KnownPair]](), list[KnownPair]()
    for pair in pairs:
        (a, b), _ = pair
        (within.setdefault(a // length, []) if a // length == b // length else left).append(pair)
    return within, left


def _list(engine: Engine, of_one: dict[int, list[KnownPair]], number: int) -> str:
    return listed(engine.artefacts, of_one.get(number, []))


def stretch(artefacts: Artefacts, frames: str, pairs: str, settings: StitchSettings) -> Parts:
    """Place frames one after another."""
    lists = Lists((frames,), (pairs,))
    mosaic, rejected = _mosaic(lists.book(artefacts), settings), list[Rejection]()
    for one in artefacts.part(frames, "list"):
        outcome = mosaic.place(places_of(artefacts, one.key, one.dead), one.name)
        mosaic.adjust()
        rejected += [outcome] if isinstance(outcome, Rejection) else []
    mosaic.retry_waiting()
    while mosaic.connect_some():
        mosaic.adjust()
    mosaic.retry_waiting()
    mosaic.adjust(everything=True)
    return _saved(mosaic, rejected, lists)


def joined(artefacts: Artefacts, parts: tuple[str, ...], pairs: str, settings: StitchSettings) -> Parts:
    """Join what was placed apart."""
    mosaic, rejected, lists = together(artefacts, parts, pairs, settings)
    mosaic.adjust(everything=True)
    return _saved(mosaic, rejected, lists)


def together(
    artefacts: Artefacts, parts: Sequence[str], pairs: str, settings: StitchSettings
) -> tuple[Mosaic, list[Rejection], Lists]:
    """One mosaic of what was placed apart, joined and linked by these pairs, which leaves a last adjustment to make."""
    known = [artefacts.part(key, "lists") for key in parts]
    lists = Lists(
        tuple(key for one in known for key in one.frames), (pairs, *(key for one in known for key in one.pairs))
    )
    book = lists.book(artefacts)
    mosaic = _mosaic(book, settings)
    for key in parts:
        one = _mosaic(book, settings)
        one.load(artefacts.part(key, "mosaic"))
        mosaic.take_over(one, AS_THEY_ARE)
    registered = [(book.name(a), book.name(b)) for (a, b), (_, is_one) in artefacts.part(pairs, "list") if is_one]
    for _ in range(ROUNDS):
        mosaic.connect(registered)
        linked, astray = mosaic.link(registered)
        if not (linked and astray):
            break
        mosaic.adjust(everything=True)
    return mosaic, [rejection for key in parts for rejection in artefacts.part(key, "rejected")], lists


@dataclass(frozen=True, slots=True)
class Lists:
    """Where frames lie, and all pairs of them that were compared."""

    frames: tuple[str, ...]
    pairs: tuple[str, ...]

    def book(self, artefacts: Artefacts) -> PairBook:
        frames = [one for key in self.frames for one in artefacts.part(key, "list")]
        known = [pair for key in self.pairs for pair in artefacts.part(key, "list")]
        return PairBook(artefacts, frames, KnownPairs(dict(known)))


def _mosaic(book: PairBook, settings: StitchSettings) -> Mosaic:
    """Without sheets of relief: no place depends on them, and they are fitted in parallel later."""
    adjustment = settings.adjustment
    without_relief = replace(adjustment, relief=replace(adjustment.relief, cells=0))
    return Mosaic(replace(settings, adjustment=without_relief), search=partial(LookUp, book), punctual=True)


def _saved(mosaic: Mosaic, rejected: Sequence[Rejection], lists: Lists) -> Parts:
    return {"summary": None, "mosaic": mosaic.saved(), "rejected": list(rejected), "lists": lists}
