"""Looks over the whole stretch of what has been paired so far, by all that is known of it: what is likelier another way?

Pairs are decided one by one as files come, by names, counters and times. What a stretch tells later (intervals of the camera's
clock, gaps in numbers) can contradict them. Names that a message gives are certain and are left alone.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from gcs_mosaic.triggers.doubts import NONE, Doubts
from gcs_mosaic.triggers.index import PendingEvent, PendingFrame, State
from gcs_mosaic.triggers.names import numbers_in
from gcs_mosaic.triggers.outcomes import How
from gcs_mosaic.triggers.sequence_offsets import ANEW

if TYPE_CHECKING:
    from gcs_mosaic.triggers.alignment import Alignment

Pair: TypeAlias = tuple[PendingEvent, PendingFrame]

LIVE = 64  # newest shots and frames that are looked over in flight
_OFF_S = 1.0  # pairs of which the camera's clock says less agree
_FITS = (
    0.9  # share of shots or files that must be paired before an ambiguous explanation is taken for want of a better one
)
_LEAST = 4  # pairs; with fewer, three might be chance


@dataclass(frozen=True, slots=True)
class Judgement:
    """Pairs that are surely to be made instead of what there is, shots whose pair is surely wrong, and what is ambiguous."""

    pairs: Sequence[Pair] = ()
    doubts: Doubts = NONE
    refuted: Sequence[PendingEvent] = ()


def judge(shots: Sequence[PendingEvent], frames: Sequence[PendingFrame], *, is_part: bool = False) -> Judgement:
    """What is likeliest for all of them together. No pair is changed where another explanation is about as good.

    `is_part`: there were more before them."""
    from gcs_mosaic.triggers import alignment  # numpy takes a while to load, and links are opened before

    is_part |= max(len(shots), len(frames)) > alignment.LONGEST
    shots = sorted(shots, key=lambda held: held.moment)[-alignment.LONGEST :]
    best, row = None, list[PendingFrame]()
    for ordered in _orders(frames[-alignment.LONGEST :]):
        found = _aligned(shots, ordered)
        if best is None or found.score > best.score + 1e-6:
            best, row = found, ordered
    if best is None or not best.told_by or len(best.pairs) < _LEAST:
        return Judgement()
    pairs = [(shots[shot], row[file]) for shot, file in best.pairs]
    changed = [(event, frame) for event, frame in pairs if frame.event is not event]
    if (
        is_part and changed and _adds_only(changed)
    ):  # which part of the shots a part of the files is of, the whole tells alone
        return Judgement(doubts=Doubts(pairs=len(changed), of=len(pairs), is_part=True))
    is_better = best.better_by is None or best.better_by > alignment.SURE
    in_doubt = max(best.unsure, best.contested)
    doubts = Doubts(best.shifts, in_doubt, max(len(pairs), in_doubt)) if in_doubt else NONE
    if _adds_only(changed):  # where there is nothing, the likeliest is chosen, and can be changed
        fits = len(changed) == len(pairs) >= _FITS * min(len(shots), len(row))
        made = changed if fits or not best.unsure else []
    else:
        sure = {(shots[shot], row[file]) for shot, file in best.sure}
        made = [pair for pair in changed if is_better and pair in sure]
    return Judgement(made, doubts, [shots[shot] for shot, _ in best.refuted] if is_better else [])


def is_odd(shots: Iterable[PendingEvent]) -> bool:
    """Whether the camera's clock contradicts some of the pairs."""
    apart = sorted(
        held.frame.frame.captured - held.moment for held in shots if held.frame and held.frame.frame.captured
    )
    if len(apart) < _LEAST:
        return False
    usual = apart[len(apart) // 2]
    return sum(abs(one - usual) > _OFF_S for one in apart) >= 2


def may_change(held: PendingEvent | PendingFrame) -> bool:
    """Whether no name and no request to a stream has settled it."""
    if isinstance(held, PendingFrame):
        return held.fresh and (held.event is None or held.event.how in (How.TIME, How.SEQUENCE))
    return held.state is not State.FAILED and held.how in (None, How.TIME, How.SEQUENCE)


def _adds_only(changed: Sequence[Pair]) -> bool:
    return all(event.frame is None and frame.event is None for event, frame in changed)


def _orders(frames: Sequence[PendingFrame]) -> list[list[PendingFrame]]:
    """The orders in which they may have been taken: by the camera's clock, by arrival, by the numbers in their names."""
    by_arrival = sorted(frames, key=lambda held: held.frame.received)
    by_numbers = sorted(frames, key=lambda held: (held.frame.vehicle or 0, *held.numbers.values()))
    if all(held.frame.captured is not None for held in frames):
        return [sorted(by_numbers, key=lambda held: held.frame.captured or 0.0)]
    return [by_arrival] if by_arrival == by_numbers else [by_arrival, by_numbers]


def _aligned(shots: Sequence[PendingEvent], frames: Sequence[PendingFrame]) -> Alignment:
    from gcs_mosaic.triggers.alignment import align
    from gcs_mosaic.triggers.rulers import FileClue, ShotClue

    place = {id(frame): number for number, frame in enumerate(frames)}
    so_far = [(number, place[id(held.frame)]) for number, held in enumerate(shots) if id(held.frame) in place]
    shot_clues = [ShotClue(held.moment, counts) for held, counts in zip(shots, _counts(shots), strict=True)]
    file_clues = [FileClue(held.numbers, held.frame.captured, held.frame.received) for held in frames]
    return align(shot_clues, file_clues, pairs_so_far=so_far)


def _counts(shots: Iterable[PendingEvent]) -> Iterator[dict[Hashable, int]]:
    """Of each shot, in their order, its number by each source, and those in the file names that were told of it. A counter that
    has begun anew (a reboot, its end) is another one from then on: file numbers go on."""
    begun = dict[Hashable, tuple[int, int]]()  # how often, and the last number
    for held in shots:
        counts = dict[Hashable, int]()
        for stream, count in held.counts:
            times, last = begun.get(stream, (0, count))
            times += count < last * ANEW
            begun[stream] = times, count
            counts[stream, times] = count
        for _, hint in held.hints:
            counts.update(numbers_in(hint))
        yield counts
