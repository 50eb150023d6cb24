"""`gcs-mosaic pair DIR`: which trigger belongs to which picture of a finished flight; and all of them so many shots later.

The pairs that were found in flight are kept in `pairing.json` as long as others are chosen, so that they can be had back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME, PAIRING_NAME, find_flight
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.records import EventRecord, EventState, FrameRecord, FrameState
from gcs_mosaic.triggers.shifted_positions import shift_by_positions

LARGEST = 16 << 20  # bytes of pairing.json: some hundred thousand pairs
MOST_SHIFT = 1000  # shots
_NO_PICTURES = (FrameState.DUPLICATE, FrameState.DAMAGED, FrameState.DROPPED)

Pairs = dict[int, str]
"""Id of an event -> name of its frame."""


@dataclass(frozen=True, slots=True)
class FoundPairs:
    """The pairs found in flight, the shift that was chosen instead, and the last event then known."""

    shift: int
    found: Pairs
    last_event: int


def pair(flight: Path, shift: int | None) -> str:
    """Choose a shift (0: as found in flight; None: as it is), and tell how it is then. Raises UsageError; CannotWrite."""
    path = find_flight(flight)
    if not (path / LEDGER_NAME).is_file():
        raise UsageError(f"{path} has no {LEDGER_NAME}: it holds no triggers and pictures that could be paired")
    if shift is not None and abs(shift) > MOST_SHIFT:
        raise UsageError(
            f"--shift {shift} is more than {MOST_SHIFT} shots: give by how many shots later each picture belongs"
        )
    if shift is None:
        with closing(Ledger(path / LEDGER_NAME, read_only=True)) as ledger:
            return _told(ledger, _kept(path))
    try:
        lock = try_lock(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written ({error.strerror}): pair a copy of it") from error
    if lock is None:
        raise UsageError(f"{path} is being written by another gcs-mosaic: pair it once that has ended")
    try:
        with closing(Ledger(path / LEDGER_NAME)) as ledger:
            return _told(ledger, _shifted(path, ledger, shift))
    finally:
        lock.release()


def contradiction(ledger: Ledger) -> int | None:
    """By how many shots later each picture belongs, if the positions of the shots fit the map far better so; else None."""
    places = {record.name: (record.island, complex(record.pose.x, record.pose.y)) for record in ledger.positions()}
    positions = {record.id: record.event.position for record in ledger.events()}
    for message in ledger.events(EventState.DUPLICATE):
        if message.duplicate_of is not None and positions.get(message.duplicate_of) is None:
            positions[message.duplicate_of] = message.event.position
    for shots in _by_aircraft(ledger.events()):
        on = [places[one.frame][0] for one in shots if one.frame in places]
        island = max(sorted(set(on)), key=on.count, default=None)
        told = [(where.latitude_deg, where.longitude_deg) if (where := positions[one.id]) else None for one in shots]
        there = [places.get(one.frame or "") for one in shots]
        found = shift_by_positions(told, [one[1] if one is not None and one[0] == island else None for one in there])
        if found:
            return found
    return None


def contradiction_text(ledger: Ledger, flight: Path) -> str | None:
    """For the operator: the positions contradict the pairs, and what to do."""
    shift, shift_so_far = contradiction(ledger), 0
    if shift is None:
        return None
    with suppress(UsageError):  # of what somebody else has put there, the pairs are as they are now
        kept = _kept(flight)
        shift_so_far = kept.shift if kept is not None else 0
    chosen = shift_so_far + shift
    return (
        f"The positions of the triggers fit the map far better if each picture belongs {_shots_later(shift)}: which trigger "
        f"belongs to which picture is ambiguous; gcs-mosaic pair {flight} --shift {chosen} chooses that, after the flight"
    )


def _shifted(path: Path, ledger: Ledger, shift: int) -> FoundPairs | None:
    """Shift the pairs found in flight; what is kept of them is written before the ledger, and removed after it."""
    events, kept = ledger.events(), _kept(path)
    now = {record.id: record.frame for record in events if record.frame is not None}
    last = max((record.id for record in events), default=0)
    since = {one: name for one, name in now.items() if kept is not None and one > kept.last_event}
    found = now if kept is None else kept.found | since
    wanted = dict(found)
    if shift:
        for shots in _by_aircraft(events):
            wanted = {one: name for one, name in wanted.items() if one not in {shot.id for shot in shots}}
            wanted |= _moved(
                [shot.id for shot in shots], found, _pictures(ledger.frames(), shots[0].event.vehicle), shift
            )
        kept = FoundPairs(shift, found, last)
        document = {"shift": shift, "last_event": last, "found": {str(one): name for one, name in found.items()}}
        write_beside(path / PAIRING_NAME, json.dumps(document).encode("ascii"), durable=True)
    with ledger.transaction():
        for record in events:
            if record.state in (EventState.DUPLICATE, EventState.FAILED) or record.frame == wanted.get(record.id):
                continue
            frame = wanted.get(record.id)
            ledger.settle_event(record.id, EventState.MISSING if frame is None else EventState.MATCHED, frame=frame)
    ledger.make_durable()
    _count_again(path, ledger)
    if not shift:
        (path / PAIRING_NAME).unlink(missing_ok=True)
        return None
    return kept


def _count_again(path: Path, ledger: Ledger) -> None:
    """The documents that tell how many triggers have a picture."""
    accounts = ledger.accounts()
    told = {"events": asdict(accounts.events), "frames": asdict(accounts.frames), "orphans": accounts.orphans}
    for name in ("mosaic.json", "status.json"):
        file = path / name
        if file.is_symlink() or not file.is_file() or file.stat().st_size > LARGEST:
            continue
        with suppress(ValueError, RecursionError):  # one that is damaged is made anew by `check --repair`
            document: Any = json.loads(file.read_bytes())
            if isinstance(document, dict):
                write_json(file, document | told)


def _moved(shots: Sequence[int], found: Mapping[int, str], pictures: Sequence[str], shift: int) -> Pairs:
    """Each picture `shift` shots later. What then lies free beside the first and the last pair, shot and picture, is paired too,
    for a picture that belonged to none may be that of the shot which lost its own."""
    frame_at = {k + shift: found[one] for k, one in enumerate(shots) if one in found}
    frame_at = {k: name for k, name in frame_at.items() if 0 <= k < len(shots)}
    if not frame_at:
        return {}
    rank, free = {name: k for k, name in enumerate(pictures)}, set(pictures) - set(frame_at.values())
    for edge, step in ((min(frame_at), -1), (max(frame_at), 1)):
        place, picture = edge + step, rank.get(frame_at[edge], 0) + step
        while 0 <= place < len(shots) and 0 <= picture < len(pictures) and pictures[picture] in free:
            frame_at[place] = pictures[picture]
            place, picture = place + step, picture + step
    return {shots[k]: name for k, name in frame_at.items()}


def _by_aircraft(events: Sequence[EventRecord]) -> list[list[EventRecord]]:
    """The shots of each aircraft, in order."""
    shots = [one for one in events if one.state not in (EventState.DUPLICATE, EventState.FAILED)]
    shots.sort(key=lambda one: (one.event.vehicle, one.id))
    return [list(group) for _, group in groupby(shots, key=lambda one: one.event.vehicle)]


def _pictures(frames: Sequence[FrameRecord], vehicle: int) -> list[str]:
    return [one.name for one in frames if one.state not in _NO_PICTURES and one.vehicle in (None, vehicle)]


def _told(ledger: Ledger, kept: FoundPairs | None) -> str:
    accounts = ledger.accounts()
    matched, shots = (
        accounts.events.matched,
        accounts.events.matched + accounts.events.missing + accounts.events.pending,
    )
    how = f"each picture {_shots_later(kept.shift)} than found in flight" if kept else "as found in flight"
    lines = [f"{matched} of {shots} triggers have a picture, {accounts.orphans} pictures have no trigger; {how}"]
    if text := contradiction_text(ledger, ledger.path.parent):
        lines.append(text)
    return "\n".join(lines)


def _shots_later(shift: int) -> str:
    return f"{abs(shift)} shot{'s' * (abs(shift) > 1)} {'later' if shift > 0 else 'earlier'}"


def _kept(path: Path) -> FoundPairs | None:
    """What is kept of the pairs found in flight; None: they are as found. Raises UsageError for what is none of ours."""
    file = path / PAIRING_NAME
    try:
        if file.is_symlink() or not file.is_file():
            if file.is_symlink() or file.exists():
                raise _none_of_ours(file)
            return None
        if file.stat().st_size > LARGEST:
            raise _none_of_ours(file)
        document: Any = json.loads(file.read_bytes())
        found = {int(one): name for one, name in document["found"].items()}
        kept = FoundPairs(document["shift"], found, document["last_event"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise _none_of_ours(file) from error
    if not isinstance(kept.shift, int) or not isinstance(kept.last_event, int):
        raise _none_of_ours(file)
    if not all(isinstance(name, str) for name in kept.found.values()):
        raise _none_of_ours(file)
    return kept


def _none_of_ours(file: Path) -> UsageError:
    return UsageError(f"{file} is none that gcs-mosaic has written: remove it, and the pairs stay as they are now")
