"""Which hints are shown, in which order."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs_mosaic.hints.hint_file import FoundThing, HintsRead, KnownHint
from gcs_mosaic.hints.hint_places import HintPlace
from gcs_mosaic.hints.rarity import FlightRarity

Reason = Literal["moves", "colour", "stands out", "sought", "detector"]
LOOKS = 2  # other looks at a place, from which it is known what moves
MOVES = 1.0  # what moves is taken for as odd as what is ten times rarer
LEAST_MINUTES = 1.0
COMPARED = 4  # times as many hints as are shown are compared with each other
# What looks the same near another hint may be the same one that has walked on, and comes after all others.
ALIKE = 24.0  # distance of colours, CIE L*a*b* of 8 bits
WALKS = 50.0  # times its size: some 30 m of a person


@dataclass(frozen=True, slots=True, kw_only=True)
class RankedHint:
    """A hint, why it is one, how odd, alike or sure it is, and where it lies, if on the map."""

    hint: KnownHint
    reason: Reason
    worth: float
    place: HintPlace | None


def ranked(
    read: HintsRead,
    places: Mapping[int, HintPlace],
    per_minute: float,
    minutes: float,
    dismissed: Collection[str] = (),
) -> list[RankedHint]:
    """The best of each kind, so many a minute of flight: picked colours first, then the detector's, then what is odd.

    What was dismissed leaves its place to nobody: what is worth less does not move up.
    """
    most = max(1, round(per_minute * max(minutes, LEAST_MINUTES)))
    shown: list[RankedHint] = []
    for kind in ("sought", "detector", "odd"):
        own = [hint for hint in read.hints if hint.found.kind == kind]
        best = sorted(_ranked(own, places, read.rarity or FlightRarity()), key=lambda one: -one.worth)
        shown += (_different_first(best[: COMPARED * most]) if kind == "odd" else best)[:most]
    return [one for one in shown if read.key(one.hint) not in dismissed]


def moves(found: FoundThing) -> bool:
    """Whether only one of several looks shows it."""
    return found.verdict.looks >= LOOKS and found.verdict.shown == 0


def _ranked(hints: Sequence[KnownHint], places: Mapping[int, HintPlace], rarity: FlightRarity) -> list[RankedHint]:
    if not hints:
        return []
    colours = rarity.of_colours(np.array([hint.found.lab for hint in hints])).tolist()
    contrasts = rarity.of_contrasts(np.array([hint.found.contrast for hint in hints])).tolist()
    return [_one(hint, places.get(hint.id), *odd) for hint, *odd in zip(hints, colours, contrasts, strict=True)]


def _one(hint: KnownHint, place: HintPlace | None, colour: float, contrast: float) -> RankedHint:
    found = hint.found
    if found.kind != "odd":
        return RankedHint(hint=hint, reason=found.kind, worth=found.score, place=place)
    worth = colour + contrast + (MOVES if moves(found) else 0.0)
    reason: Reason = "moves" if moves(found) else "colour" if colour > contrast else "stands out"
    return RankedHint(hint=hint, reason=reason, worth=worth, place=place)


def _different_first(best: Sequence[RankedHint]) -> list[RankedHint]:
    """The same in another order: what looks like a better one nearby comes last."""
    first: list[RankedHint] = []
    last: list[RankedHint] = []
    for one in best:
        (last if any(_may_be_the_same(one, other) for other in first) else first).append(one)
    return [*first, *last]


def _may_be_the_same(one: RankedHint, other: RankedHint) -> bool:
    here, there = one.place, other.place
    if here is None or there is None or here.island != there.island:
        return False
    if np.hypot(here.x - there.x, here.y - there.y) > WALKS * max(here.size, there.size):
        return False
    return float(np.linalg.norm(np.subtract(one.hint.found.lab, other.hint.found.lab))) <= ALIKE
