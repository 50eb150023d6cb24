"""Stage 6: stretches of frames are placed, each by itself, and then joined, some at a time, until a few are left.

Within a stretch frames are placed one after another and islands joined, as in a flight, but each comparison is looked up. That
costs more than all that follows, and there is a worker's task for each stretch. Joining moves whole islands, by pairs of frames
of two stretches, links all such pairs that agree with that, and adjusts the islands. What is placed is folded before it is kept:
the places of features and most matches lie in the store already, and a task that joins thousands of frames needs few of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import TypeVar

from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import places_of
from gcs_mosaic.archive.look_up import LookUp, NumberedFrame, PairBook
from gcs_mosaic.archive.pairs import KnownPairs, Pair
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Rejection
from gcs_mosaic.stitch.graph.union import Renamed
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

logger = logging.getLogger(__name__)

T = TypeVar("T")

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
        task(stretch, engine.listed(frames[at : at + length]), _list(engine, of_one, at // length), settings)
        for at in range(0, len(frames), length)
    ]
    engine.made("stretches", parts)
    while len(parts) > JOINED:
        length *= JOINED
        of_one, left = _shared_out(left, length)
        groups = [tuple(one.key for one in parts[at : at + JOINED]) for at in range(0, len(parts), JOINED)]
        parts = [task(joined, group, _list(engine, of_one, at), settings) for at, group in enumerate(groups)]
        engine.made(f"joining, {length} frames", parts)
    return LeftToJoin(tuple(one.key for one in parts), engine.listed(left))


def _shared_out(pairs: Sequence[KnownPair], length: int) -> tuple[dict[int, list[KnownPair]], list[KnownPair]]:
    """Pairs within each stretch of this length, and the others."""
    within, left = dict[int, list[KnownPair]](), list[KnownPair]()
    for pair in pairs:
        (a, b), _ = pair
        (within.setdefault(a // length, []) if a // length == b // length else left).append(pair)
    return within, left


def _list(engine: Engine, of_one: dict[int, list[KnownPair]], number: int) -> str:
    return engine.listed(of_one.get(number, []))


def stretch(artefacts: Artefacts, frames: str, pairs: str, settings: StitchSettings) -> Parts:
    """Place frames one after another."""
    found = _begun(artefacts, Lists((frames,), (pairs,)), settings)
    mosaic = found.mosaic
    for one in artefacts.part(frames, "list"):
        found.rejected += _placed(mosaic, places_of(artefacts, one.key, one.dead), one)
        _tried(mosaic.adjust)
    _tried(mosaic.retry_waiting)
    while _tried(mosaic.connect_some) is not False:
        _tried(mosaic.adjust)
    _tried(mosaic.retry_waiting)
    _tried(partial(mosaic.adjust, everything=True))
    return found.parts()


def _placed(mosaic: Mosaic, features: Features, frame: NumberedFrame) -> list[Rejection]:
    """Place a frame; its rejection, if it is rejected at once."""
    try:
        outcome = mosaic.place(features, frame.name, aircraft=frame.folder)
    except Lost:
        raise  # not the frame's fault
    except Exception as error:
        logger.exception("%s could not be placed", frame.name)
        return [Rejection(frame.name, f"it could not be processed ({error!r})")]
    return [outcome] if isinstance(outcome, Rejection) else []


def joined(artefacts: Artefacts, parts: tuple[str, ...], pairs: str, settings: StitchSettings) -> Parts:
    """Join what was placed apart."""
    found = together(artefacts, parts, pairs, settings)
    _tried(partial(found.mosaic.adjust, everything=True))
    return found.parts()


def together(artefacts: Artefacts, parts: Sequence[str], pairs: str, settings: StitchSettings) -> PlacedTogether:
    """What was placed apart, joined and linked by these pairs; its last adjustment is left to make."""
    found = _begun(artefacts, Lists.of([artefacts.part(key, "lists") for key in parts], pairs), settings)
    mosaic, book = found.mosaic, found.book
    for key in parts:
        one = _mosaic(book, settings)
        one.load(artefacts.part(key, "mosaic"))
        mosaic.take_over(one, AS_THEY_ARE)
        found.rejected += artefacts.part(key, "rejected")
    mosaic.unfold(book.points)
    registered = [(book.name(a), book.name(b)) for (a, b), (_, is_one) in artefacts.part(pairs, "list") if is_one]
    for _ in range(ROUNDS):
        _tried(partial(mosaic.connect, registered))
        linked, astray = _tried(partial(mosaic.link, registered)) or (0, 0)
        if not (linked and astray):
            break
        _tried(partial(mosaic.adjust, everything=True))
    return found


def _tried(step: Callable[[], T]) -> T | None:
    """What a step of a mosaic brings; None if it raises, which has left what it was about as it was. Raises Lost."""
    try:
        return step()
    except Lost:
        raise  # nothing is kept of what lacks it
    except Exception:
        logger.warning("a step of the assembly has failed", exc_info=True)
        return None


@dataclass(slots=True)
class PlacedTogether:
    """Frames that were placed by one task."""

    mosaic: Mosaic
    book: PairBook
    lists: Lists
    rejected: list[Rejection] = field(default_factory=list)

    def parts(self) -> Parts:
        """What is kept of it. Raises Lost if anything was that it needed."""
        self.book.check()
        self.mosaic.fold()
        return {"summary": None, "mosaic": self.mosaic.saved(), "rejected": self.rejected, "lists": self.lists}


@dataclass(frozen=True, slots=True)
class Lists:
    """Where frames lie, and all pairs of them that were compared."""

    frames: tuple[str, ...]
    pairs: tuple[str, ...]

    @staticmethod
    def of(parts: Sequence[Lists], pairs: str) -> Lists:
        """Those of several parts, and the pairs between them."""
        return Lists(tuple(chain(*(one.frames for one in parts))), (pairs, *chain(*(one.pairs for one in parts))))

    def book(self, artefacts: Artefacts) -> PairBook:
        frames = [one for key in self.frames for one in artefacts.part(key, "list")]
        known = [pair for key in self.pairs for pair in artefacts.part(key, "list")]
        return PairBook(artefacts, frames, KnownPairs(dict(known)))


def _begun(artefacts: Artefacts, lists: Lists, settings: StitchSettings) -> PlacedTogether:
    book = lists.book(artefacts)
    return PlacedTogether(_mosaic(book, settings), book, lists)


def _mosaic(book: PairBook, settings: StitchSettings) -> Mosaic:
    """Without sheets of relief: no place depends on them, and they are fitted in parallel later."""
    adjustment = settings.adjustment
    without_relief = replace(adjustment, relief=replace(adjustment.relief, cells=0))
    return Mosaic(replace(settings, adjustment=without_relief), search=partial(LookUp, book), punctual=True)
