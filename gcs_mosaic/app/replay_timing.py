"""Arrival times of a recorded flight's frames, derived from the recording and the files alone, so that they are reproducible.

The files' own times are used if they lie within the recording. Copies lose them, and a camera's clock may be wrong: then
the events decide, by the file names they give, else by their counters and the numbers in file names, else by order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from gcs_mosaic.frames.scan import Look
from gcs_mosaic.mavlink.tlog_reader import RecordedLink
from gcs_mosaic.messages import CaptureResult, TriggerEvent
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.index import number_in
from gcs_mosaic.triggers.shots import CameraMessage, New

MOST = 0.9  # of all files: some were there before the flight, or were touched later
ENOUGH = 0.75  # of the candidates: fewer matching names or numbers may be chance
COARSE_S = 2.0  # resolution of file times on a memory card's file system (FAT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrivals:
    """For each file, in the order given: its arrival in seconds on the recording's clock, and whether it is known to belong to
    the flight; `told_by` names the evidence, for display."""

    seconds: list[float]
    fresh: list[bool]
    told_by: str


def arrivals(
    looks: Sequence[Look], link: RecordedLink, messages: Iterable[CameraMessage], found_after_s: float
) -> Arrivals:
    """When files (in the order of their names) arrived; a file is found `found_after_s` after its last write."""
    if by_times := _by_file_times(looks, link, found_after_s):
        return by_times
    taken = _taken(messages)
    ways = {
        "the file names in the camera messages": (_by_names, link.events),
        "the numbers in the file names": (_by_numbers, link.events),
        "the order of the shots": (_by_order, taken),
    }
    for told_by, (way, events) in ways.items():
        known = way(looks, events)
        if known and len(known) >= ENOUGH * min(len(looks), len(taken)):
            seconds = _filled_up(known, len(looks))
            return Arrivals(seconds=seconds, fresh=[True] * len(looks), told_by=told_by)
    spread = [link.seconds * k / len(looks) for k in range(len(looks))]
    return Arrivals(seconds=spread, fresh=[True] * len(looks), told_by="nothing: spread evenly over the recording")


def _by_file_times(looks: Sequence[Look], link: RecordedLink, found_after_s: float) -> Arrivals | None:
    if link.began_utc is None:
        return None
    written = [look.modified_ns / 1e9 - link.began_utc for look in looks]
    within = sum(-COARSE_S <= seconds <= link.seconds + COARSE_S for seconds in written)
    if within < MOST * len(looks):
        return None
    last = link.seconds + COARSE_S
    return Arrivals(
        seconds=[min(max(seconds, 0.0), last) + found_after_s for seconds in written],
        fresh=[seconds >= -COARSE_S for seconds in written],
        told_by="the files' times",
    )


def _taken(messages: Iterable[CameraMessage]) -> list[TriggerEvent]:
    """The first message about each shot."""
    told = [message.event for message in messages if isinstance(message.verdict, New)]
    return [event for event in told if event.result is not CaptureResult.FAILED]


def _by_names(looks: Sequence[Look], events: Sequence[TriggerEvent]) -> dict[int, float]:
    named: dict[str, float] = {}
    for event in events:
        named.setdefault((event.file_hint or "").casefold(), event.received)
    names = [look.path.name.casefold() for look in looks]
    return {place: named[name] for place, name in enumerate(names) if name in named}


def _by_numbers(looks: Sequence[Look], events: Sequence[TriggerEvent]) -> dict[int, float]:
    """The matching of file numbers to a counter, at an offset, that gives the most files an event."""
    numbers = {place: number for place, look in enumerate(looks) if (number := number_in(look.path.name)) is not None}
    best: dict[int, float] = {}
    for counted in _counters(events):
        apart = Counter(number - count for number in numbers.values() for count in counted)
        # Ties go to the most natural offset: the first file is the first shot.
        first = next(iter(numbers.values()), 0) - next(iter(counted))
        offset = max(apart, key=lambda one: (apart[one], -abs(one - first)), default=0)
        known = {place: counted[number - offset] for place, number in numbers.items() if number - offset in counted}
        best = max(best, known, key=len)
    return best


def _counters(events: Sequence[TriggerEvent]) -> list[dict[int, float]]:
    """Time of each count, per source."""

    def stream(event: TriggerEvent) -> StreamKey:
        return StreamKey(event.vehicle, event.component, event.camera, event.source)

    counted = []
    for _, heard in groupby(sorted(events, key=stream), stream):
        times: dict[int, float] = {}
        for event in heard:
            if event.sequence is not None and event.result is not CaptureResult.FAILED:
                times.setdefault(event.sequence, event.received)
        if times:
            counted.append(times)
    return counted


def _by_order(looks: Sequence[Look], shots: Sequence[TriggerEvent]) -> dict[int, float]:
    return {place: shot.received for place, (_, shot) in enumerate(zip(looks, shots, strict=False))}


def _filled_up(known: dict[int, float], count: int) -> list[float]:
    """An unmatched file arrived with the one before it."""
    seconds, last = [], min(known.values())
    for place in range(count):
        last = known.get(place, last)
        seconds.append(last)
    return seconds
