"""Shots that are not on the map, and where they should be: between those that were taken just before and just after.

Times give the order, and how far between; the places are those of the frames around, so nothing but images says where anything
lies. A shot at the end of the flight, or between two parts of the map, is told without a place.
"""

from __future__ import annotations

from bisect import bisect
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from gcs_mosaic.store.records import EventRecord, EventState, FrameRecord, FrameState
from gcs_mosaic.views.flight_view import FlightView, FrameTable

LONGEST = 6.0  # times the usual pause between two shots: over a longer one the aircraft may have been anywhere
LEAST_S = 4.0
MOST = 500  # of each kind
NO_PICTURE = "no picture has come"
NOTHING_YET = "nothing that it shows is on the map yet"
OFF_THE_MAP = {FrameState.WAITING, FrameState.REJECTED, FrameState.DAMAGED, FrameState.DROPPED, FrameState.UNSTITCHED}


@dataclass(frozen=True, slots=True, kw_only=True)
class AbsentShot:
    """`name`: of its frame, or of the file that was announced, if any; `place`: on its island's canvas, where that is known."""

    name: str
    state: str
    reason: str
    island: int | None = None
    place: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class _Moment:
    """When a frame that is on the map was taken, seconds, and where it lies."""

    time: float
    island: int
    x: float
    y: float


class _Track:
    """Where the camera was, by the frames of which times and places are known."""

    def __init__(self, times: Mapping[str, float], middles: Mapping[str, tuple[int, float, float]]) -> None:
        known = [_Moment(time, *middles[name]) for name, time in times.items() if name in middles]
        self._known = sorted(known, key=lambda one: one.time)
        self._times = [one.time for one in self._known]
        pauses = [later - sooner for sooner, later in pairwise(self._times)]
        self._longest = max(LEAST_S, LONGEST * median(pauses)) if pauses else 0.0

    def at(self, time: float | None) -> _Moment | None:
        """None where that is not known."""
        if time is None or not 0 < (index := bisect(self._times, time)) < len(self._known):
            return None
        before, after = self._known[index - 1], self._known[index]
        pause = after.time - before.time
        if before.island != after.island or pause > self._longest:
            return None
        share = (time - before.time) / pause if pause else 0.5
        x, y = before.x + share * (after.x - before.x), before.y + share * (after.y - before.y)
        return _Moment(time, before.island, x, y)


def absent_shots(view: FlightView) -> list[AbsentShot]:
    """The newest frames and the newest events of them, each in the order of the ledger: many events that somebody forged push no
    frame off the list. Raises UsageError."""
    events, frames, table = view.events(), view.frames(), view.table()
    middles = dict(_middles(table))
    heard = {event.frame: event.event.received for event in events if event.frame is not None}
    by_events = _Track(heard, middles)
    by_files = _Track({frame.name: frame.modified for frame in frames if frame.modified is not None}, middles)
    left_out = view.shots_of_other_cameras()
    missing = _of_events((event for event in events if event.id not in left_out), by_events)
    off_the_map = _of_frames(frames, heard, by_events, by_files)
    return [*deque(off_the_map, MOST), *deque(missing, MOST)]


def _of_frames(
    frames: Iterable[FrameRecord],
    heard: Mapping[str, float],
    by_events: _Track,
    by_files: _Track,
) -> Iterator[AbsentShot]:
    for frame in frames:
        if frame.state not in OFF_THE_MAP:
            continue
        place = by_events.at(heard[frame.name]) if frame.name in heard else by_files.at(frame.modified)
        reason = frame.reason or NOTHING_YET
        yield _shot(frame.name, str(frame.state), reason, place)


def _of_events(events: Iterable[EventRecord], by_events: _Track) -> Iterator[AbsentShot]:
    for event in events:
        if event.state is EventState.MISSING:
            name = event.event.file_hint or ""
            yield _shot(name, str(event.state), NO_PICTURE, by_events.at(event.event.received))


def _shot(name: str, state: str, reason: str, place: _Moment | None) -> AbsentShot:
    if place is None:
        return AbsentShot(name=name, state=state, reason=reason)
    return AbsentShot(name=name, state=state, reason=reason, island=place.island, place=(place.x, place.y))


def _middles(table: FrameTable) -> Iterator[tuple[str, tuple[int, float, float]]]:
    for frame, outline in zip(table.frames, table.outlines, strict=True):
        x, y = outline.mean(axis=0).tolist()
        if np.isfinite([x, y]).all():
            yield frame.name, (frame.island, x, y)
