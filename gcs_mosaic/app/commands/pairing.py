"""`gcs-mosaic pair DIR`: which trigger belongs to which picture of a finished flight; and all of them so many shots later.

The pairs that were found in flight are kept in `pairing.json` as long as others are chosen, so that they can be had back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gcs_mosaic.app.inputs.pairing_check import (
    LARGEST,
    FoundPairs,
    Pairs,
    contradiction_text,
    kept_pairs,
    shots_by_aircraft,
    shots_later,
)
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME, PAIRING_NAME, find_flight
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.records import EventState, FrameRecord, FrameState

MOST_SHIFT = 1000  # shots
_NO_PICTURES = (FrameState.DUPLICATE, FrameState.DAMAGED, FrameState.DROPPED)


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
            return _told(ledger, kept_pairs(path))
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


def _shifted(path: Path, ledger: Ledger, shift: int) -> FoundPairs | None:
    """Shift the pairs found in flight; what is kept of them is written before the ledger, and removed after it."""
    events, kept = ledger.events(), kept_pairs(path)
    now = {record.id: record.frame for record in events if record.frame is not None}
    last = max((record.id for record in events), default=0)
    since = {one: name for one, name in now.items() if kept is not None and one > kept.last_event}
    found = now if kept is None else kept.found | since
    wanted = dict(found)
    if shift:
        for shots in shots_by_aircraft(events):
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


def _pictures(frames: Sequence[FrameRecord], vehicle: int) -> list[str]:
    return [one.name for one in frames if one.state not in _NO_PICTURES and one.vehicle in (None, vehicle)]


def _told(ledger: Ledger, kept: FoundPairs | None) -> str:
    accounts = ledger.accounts()
    matched, shots = (
        accounts.events.matched,
        accounts.events.matched + accounts.events.missing + accounts.events.pending,
    )
    how = f"each picture {shots_later(kept.shift)} than found in flight" if kept else "as found in flight"
    lines = [f"{matched} of {shots} triggers have a picture, {accounts.orphans} pictures have no trigger; {how}"]
    if text := contradiction_text(ledger, ledger.path.parent):
        lines.append(text)
    return "\n".join(lines)
