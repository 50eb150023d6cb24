"""`gcs-mosaic vehicle`: which aircraft a flight hears, and the choice of one of them."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.folder import candidates, find_flight
from gcs_mosaic.store.reading import read_document
from gcs_mosaic.store.requests import ask_to_follow
from gcs_mosaic.store.status import harmless

logger = logging.getLogger(__name__)

ANSWER_S = 8.0  # for the flight to answer: it looks once a second, and between two frames only
_MOST_TRIED = 100  # numbered folders


def follow(flight: Path, vehicle: int) -> str:
    """Have the running flight follow this aircraft; returns its answer. Raises UsageError if it is not taken."""
    flight = running_flight(flight)
    try:
        answer = ask_to_follow(flight, vehicle, ANSWER_S)
    except (OSError, DiskFull) as error:
        raise UsageError(f"{flight} cannot be written ({error}): only who flies the flight can choose") from error
    if answer is None:
        raise UsageError(f"the flight in {flight} does not answer, so nothing was changed: is it still running?")
    if not answer.taken:
        raise UsageError(f"{answer.text}: gcs-mosaic vehicle lists the aircraft")
    return answer.text


def heard_aircraft(flight: Path, now_utc: float | None = None) -> str:
    """The aircraft that a flight hears or has heard, one a line. Raises UsageError."""
    flight = running_flight(flight, ended_too=True)
    document = _status(flight)
    if document is None:
        raise UsageError(f"{flight} has no status that can be read: start the flight first")
    lines = [harmless(line) for line in aircraft_lines(document, now_utc or time.time())]
    return "\n".join(lines) or f"no aircraft has been heard in {flight}"


def running_flight(out: Path, *, ended_too: bool = False) -> Path:
    """The flight under way in `out`, `out-2`, …, or the newest of all if `ended_too`. Raises UsageError."""
    found: dict[Path, dict[str, Any]] = {}
    for path, _ in zip(candidates(out), range(_MOST_TRIED), strict=False):
        if (document := _status(path)) is not None and (ended_too or document.get("state") != "stopped"):
            found[path] = document
    if not found and not ended_too:
        raise UsageError(f"no flight is under way in {out}: name the --out of a running one")
    return max(found, key=lambda path: str(found[path].get("updated"))) if found else find_flight(out)


def aircraft_lines(document: dict[str, Any], now_utc: float) -> Iterator[str]:
    """One line per aircraft of the document of `status_document`, which may come from several links."""
    newest: dict[int, dict[str, Any]] = {}
    followed = {link.get("followed") for link in document["mavlink"]}
    for link in document["mavlink"]:
        for one in link.get("aircraft", ()):
            before = newest.get(one["system"])
            if before is None or (one["last_heard"] or "") > (before["last_heard"] or ""):
                newest[one["system"]] = one
    for system, one in sorted(newest.items()):
        yield f"system {system}: {', '.join(_words(one, system in followed, now_utc))}"


def _words(one: dict[str, Any], is_followed: bool, now_utc: float) -> Iterator[str]:
    if is_followed:
        yield "followed"
    yield one["described"] or "of unknown kind"
    if one["last_heard"] is None:
        yield "triggers a camera without a heartbeat"
    else:
        yield f"heard {max(0.0, now_utc - datetime.fromisoformat(one['last_heard']).timestamp()):.0f} s ago"


def _status(flight: Path) -> dict[str, Any] | None:
    try:
        document = read_document(flight / "status.json")
    except (OSError, ValueError):
        logger.debug("%s has no status", flight, exc_info=True)
        return None
    return document if isinstance(document.get("mavlink"), list) else None
