"""Whether the positions of the shots contradict their pairs with pictures, and the pairs that were found in flight."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.folder import PAIRING_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventRecord, EventState
from gcs_mosaic.store.typed import typed
from gcs_mosaic.triggers.shifted_positions import shift_by_positions

LARGEST = 16 << 20  # bytes of pairing.json: some hundred thousand pairs

Pairs = dict[int, str]
"""Id of an event -> name of its frame."""


@dataclass(frozen=True, slots=True)
class FoundPairs:
    """The pairs found in flight, the shift that was chosen instead, and the last event then known."""

    shift: int
    found: Pairs
    last_event: int


def contradiction(ledger: Ledger) -> int | None:
    """By how many shots later each picture belongs, if the positions of the shots fit the map far better so; else None."""
    places = {record.name: (record.island, complex(record.pose.x, record.pose.y)) for record in ledger.positions()}
    positions = {record.id: record.event.position for record in ledger.events()}
    for message in ledger.events(EventState.DUPLICATE):
        if message.duplicate_of is not None and positions.get(message.duplicate_of) is None:
            positions[message.duplicate_of] = message.event.position
    for shots in shots_by_aircraft(ledger.events()):
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
        kept = kept_pairs(flight)
        shift_so_far = kept.shift if kept is not None else 0
    return shifted_text(flight, shift, shift_so_far + shift)


def shifted_text(flight: Path, shift: int, chosen: int) -> str:
    """`shift`: by how many shots the pairs are off; `chosen`: which one `gcs-mosaic pair` is to be given."""
    return (
        f"The positions of the triggers fit the map far better if each picture belongs {shots_later(shift)}: which trigger "
        f"belongs to which picture is ambiguous; gcs-mosaic pair {typed(flight)} --shift {chosen} chooses that, after the flight"
    )


def kept_pairs(path: Path) -> FoundPairs | None:
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


def shots_by_aircraft(events: Sequence[EventRecord]) -> list[list[EventRecord]]:
    """The shots of each aircraft, in order."""
    shots = [one for one in events if one.state not in (EventState.DUPLICATE, EventState.FAILED)]
    shots.sort(key=lambda one: (one.event.vehicle, one.id))
    return [list(group) for _, group in groupby(shots, key=lambda one: one.event.vehicle)]


def shots_later(shift: int) -> str:
    return f"{abs(shift)} shot{'s' * (abs(shift) > 1)} {'later' if shift > 0 else 'earlier'}"


def _none_of_ours(file: Path) -> UsageError:
    return UsageError(f"{file} is none that gcs-mosaic has written: remove it, and the pairs stay as they are now")
