"""Arrival times of a recorded flight's frames, derived from the recording and the files alone, so that they are reproducible.

The files' own times are used if they lie within the recording. Copies lose them, and a camera's clock may be wrong: then
the file names in the messages decide, else what is likeliest by numbers, the camera's clock, and order together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC

from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.mavlink.tlog_reader import RecordedLink
from gcs_mosaic.messages import CaptureResult, TriggerEvent
from gcs_mosaic.triggers.alignment import MOST, Alignment, align
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.doubts import NONE, Doubts
from gcs_mosaic.triggers.names import folder_and_base, numbers_in, stem_of
from gcs_mosaic.triggers.rulers import FileClue, ShotClue
from gcs_mosaic.triggers.shots import CameraMessage, New

MOST_WITHIN = 0.9  # of all files: some were there before the flight, or were touched later
FILE_TIMES = "the files' times"
NAMES = "the file names in the camera messages"
ENOUGH = 0.75  # of the candidates: fewer matching names or numbers may be chance
COARSE_S = 2.0  # resolution of file times on a memory card's file system (FAT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrivals:
    """For each file, in the order given: its arrival in seconds on the recording's clock, and whether it is known to belong to
    the flight; `told_by` names the evidence, for display."""

    seconds: list[float]
    fresh: list[bool]
    told_by: str
    doubts: Doubts = NONE


def arrivals(
    looks: Sequence[Look], link: RecordedLink, messages: Iterable[CameraMessage], found_after_s: float
) -> Arrivals:
    """When files (in the order of their names) arrived; a file is found `found_after_s` after its last write."""
    if by_times := _by_file_times(looks, link, found_after_s):
        return by_times
    taken = _taken(messages)
    named = _by_names(looks, taken)
    known, told = {place: taken[shot].event.received for shot, place in named}, Alignment([], (), 0, (), 0.0)
    if len(known) < ENOUGH * min(len(looks), len(taken)):
        told = _by_likelihood(looks, taken, named, link.began_utc)
        known |= {place: taken[shot].event.received for shot, place in told.pairs}
    if known and len(known) >= ENOUGH * min(len(looks), len(taken)):
        how = " and ".join(told.told_by) or "the order of the shots" if told.pairs else NAMES
        fresh = [True] * len(looks)
        doubts = Doubts(shifts=told.shifts, pairs=told.unsure, of=len(told.pairs))
        return Arrivals(seconds=_filled_up(known, len(looks)), fresh=fresh, told_by=how, doubts=doubts)
    spread = [link.seconds * k / len(looks) for k in range(len(looks))]
    return Arrivals(seconds=spread, fresh=[True] * len(looks), told_by="nothing: spread evenly over the recording")


def _by_file_times(looks: Sequence[Look], link: RecordedLink, found_after_s: float) -> Arrivals | None:
    if link.began_utc is None:
        return None
    written = [look.modified_ns / 1e9 - link.began_utc for look in looks]
    within = sum(-COARSE_S <= seconds <= link.seconds + COARSE_S for seconds in written)
    if within < MOST_WITHIN * len(looks):
        return None
    last = link.seconds + COARSE_S
    return Arrivals(
        seconds=[min(max(seconds, 0.0), last) + found_after_s for seconds in written],
        fresh=[seconds >= -COARSE_S for seconds in written],
        told_by=FILE_TIMES,
    )


@dataclass(frozen=True, slots=True)
class _Taken:
    """The first message about a shot, the numbers that all messages give it, and the file names."""

    event: TriggerEvent
    moment: float
    counts: dict[Hashable, int]
    stems: set[str]


def _taken(messages: Iterable[CameraMessage]) -> list[_Taken]:
    shots: dict[int, _Taken] = {}
    for message in messages:
        event, verdict = message.event, message.verdict
        if isinstance(verdict, New):
            shots[message.number] = _Taken(event, verdict.moment, {}, set())
        shot = shots.get(message.number if isinstance(verdict, New) else verdict.of)
        if shot is not None and event.sequence is not None:
            shot.counts[StreamKey(event.vehicle, event.component, event.camera, event.source)] = event.sequence
        if shot is not None and event.file_hint:
            _, base = folder_and_base(event.file_hint)
            shot.stems.add(stem_of(base))
            shot.counts.update(numbers_in(base))
    took = [shot for shot in shots.values() if shot.event.result is not CaptureResult.FAILED]
    return sorted(took, key=lambda shot: shot.moment)


def _by_names(looks: Sequence[Look], shots: Sequence[_Taken]) -> list[tuple[int, int]]:
    """Pairs of a shot and the file that it names."""
    named = {stem: place for place, shot in reversed(list(enumerate(shots))) for stem in shot.stems}
    stems = [stem_of(look.path.name) for look in looks]
    return [(named[stem], place) for place, stem in enumerate(stems) if stem in named]


def _by_likelihood(
    looks: Sequence[Look], shots: Sequence[_Taken], named: Sequence[tuple[int, int]], began_utc: float | None
) -> Alignment:
    """The pairs among the shots and files that no name connects; a shot whose file has another name is none of them."""
    taken, placed = {shot for shot, _ in named}, {place for _, place in named}
    free = [k for k, shot in enumerate(shots) if k not in taken and not (named and shot.stems)]
    times = [capture_time(look.path) for look in looks]
    captured = [None if time is None else time.replace(tzinfo=UTC).timestamp() for time in times]
    files = [place for place in range(len(looks)) if place not in placed]
    if None not in captured:
        files.sort(key=lambda place: captured[place] or 0.0)  # stable: of one second in the order of names
    shot_clues = [ShotClue(shots[k].moment, shots[k].counts) for k in free]
    file_clues = [FileClue(numbers_in(looks[place].path.name), captured[place]) for place in files]
    told = _aligned(shot_clues, file_clues, began_utc)
    return replace(told, pairs=[(free[shot], files[file]) for shot, file in told.pairs])


def _aligned(shots: Sequence[ShotClue], files: Sequence[FileClue], began_utc: float | None) -> Alignment:
    """Long rows one part after another: numbers go on as in the first part, what they do not tell is aligned."""
    share = min(1.0, MOST / max(len(shots), len(files), 1))
    most_shots, most_files = round(len(shots) * share), round(len(files) * share)
    told = align(shots[:most_shots], files[:most_files], began_utc)
    pairs = list(told.pairs)
    while pairs:
        shot, file = pairs[-1][0] + 1, pairs[-1][1] + 1
        row, against = shots[shot : shot + most_shots], files[file : file + most_files]
        found = _by_numbers(pairs, shots, files, range(shot, shot + len(row)))
        if len(found) < ENOUGH * min(len(row), len(against)):
            part = align(row, against, began_utc)
            found = [(shot + one, file + other) for one, other in part.pairs]
            told = replace(told, shifts=tuple({*told.shifts, *part.shifts}), unsure=told.unsure + part.unsure)
        if not found:
            break
        pairs += found
    return replace(told, pairs=pairs)


def _by_numbers(
    pairs: Sequence[tuple[int, int]], shots: Sequence[ShotClue], files: Sequence[FileClue], row: range
) -> list[tuple[int, int]]:
    """Pairs of these shots, by the numbers that differ by as much in nearly all pairs so far."""
    apart = Counter(
        (key, place, number - count)
        for shot, file in pairs[-MOST:]
        for key, count in shots[shot].counts.items()
        for place, number in files[file].numbers.items()
    )
    ((key, place, offset), times), *_ = [*apart.most_common(1), ((None, ("", 0), 0), 0)]
    if times < ENOUGH * min(len(pairs), MOST):
        return []
    file_of = {one.numbers[place]: k for k, one in enumerate(files) if k > pairs[-1][1] and place in one.numbers}
    wanted = [(shot, shots[shot].counts[key] + offset) for shot in row if key in shots[shot].counts]
    found = [(shot, file_of[number]) for shot, number in wanted if number in file_of]
    return [pair for k, pair in enumerate(found) if not k or pair[1] > found[k - 1][1]]


def _filled_up(known: dict[int, float], count: int) -> list[float]:
    """An unmatched file arrived with the one before it."""
    seconds, last = [], min(known.values())
    for place in range(count):
        last = known.get(place, last)
        seconds.append(last)
    return seconds
