"""What a run says of itself: `status.json` of a live flight, for the page too; all of it for `gcs-mosaic status`."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Aircraft, LinkReport, SourceReport
from gcs_mosaic.store import inside
from gcs_mosaic.store.documents import finite, iso_utc
from gcs_mosaic.store.folder import PROGRESS_NAME, find_flight
from gcs_mosaic.store.held_out import Figures, held_out_entry, held_out_words
from gcs_mosaic.store.progress import progress_json, progress_lines
from gcs_mosaic.store.reading import MOSAIC_NAME, read_document
from gcs_mosaic.store.records import Accounts, NoticeRecord
from gcs_mosaic.store.told_documents import (
    FORMAT,
    AircraftEntry,
    ConditionEntry,
    DaemonState,
    FleetMemberEntry,
    LastFrameEntry,
    LinkEntry,
    NoticeEntry,
    Outcome,
    Severity,
    StatusDocument,
    WatchEntry,
)

STATUS_NAME = "status.json"
HUNG_AFTER_S = 8.0  # a running daemon writes its status at least every two seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class LastFrame:
    """The last processed frame; `outcome` is a frame state."""

    name: str
    outcome: str
    island: int | None
    utc: float
    seconds_to_tile: float | None  # from the file being complete to its tiles being on disk
    reason: str | None = None
    covered_by: str | None = None  # the placed frame that shows the same area


@dataclass(frozen=True, slots=True, kw_only=True)
class Behind:
    """The backlog: frames waiting to be processed, and how long ago the first of them arrived."""

    frames: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftStatus:
    """One of several aircraft. Without `source` its frames come from that of all, and which are waiting is not known."""

    system: int  # MAVLink system id
    source: SourceReport | None = None
    behind: Behind = field(default_factory=Behind)
    last_frame: LastFrame | None = None
    accounts: Accounts = field(default_factory=Accounts)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What is so now and wants to be known, in a sentence; `key` tells them apart."""

    key: str
    level: Severity
    text: str
    since_utc: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The content of status.json. Written at least every two seconds: an old `updated` means a hung daemon."""

    flight: str
    state: DaemonState
    updated_utc: float
    started_utc: float
    revision: int = 0
    mavlink: tuple[LinkReport, ...] = ()
    watch: SourceReport | None = None
    behind: Behind = field(default_factory=Behind)
    last_frame: LastFrame | None = None
    accounts: Accounts = field(default_factory=Accounts)
    aircraft: tuple[AircraftStatus, ...] = ()  # where several fly
    held_out: Figures = field(default_factory=dict)  # held-out error by island
    conditions: tuple[Condition, ...] = ()  # the worst first
    notices: tuple[NoticeRecord, ...] = ()  # the newest few, oldest first


def status_document(status: Status) -> StatusDocument:
    """The content of status.json."""
    return StatusDocument(
        format=FORMAT,
        flight=status.flight,
        state=status.state,
        updated=iso_utc(status.updated_utc),
        started=iso_utc(status.started_utc),
        revision=status.revision,
        mavlink=[link_entry(link) for link in status.mavlink],
        watch=watch_entry(status.watch),
        frames_in_queue=status.behind.frames,
        seconds_behind=round(status.behind.seconds, 1),
        last_frame=last_frame_entry(status.last_frame),
        events=status.accounts.events,
        frames=status.accounts.frames,
        orphans=status.accounts.orphans,
        aircraft=[fleet_entry(one) for one in status.aircraft] or None,
        held_out_px={str(island): held_out_entry(found) for island, found in status.held_out.items()},
        conditions=[condition_entry(one) for one in status.conditions],
        notices=[notice_entry(notice) for notice in status.notices],
    )


def link_entry(link: LinkReport) -> LinkEntry:
    return LinkEntry(
        address=link.address,
        state=link.state,
        last_heard=moment(link.last_heard_utc),
        silences=link.silences,
        followed=link.followed,
        counted=link.counted or None,
        aircraft=[aircraft_entry(one) for one in link.aircraft],
        other_triggers={str(system): count for system, count in link.others},
        refused=link.refused,
        sent=link.sent,
    )


def fleet_entry(one: AircraftStatus) -> FleetMemberEntry:
    """One of several aircraft."""
    return FleetMemberEntry(
        system=one.system,
        watch=watch_entry(one.source),
        frames_in_queue=one.behind.frames,
        seconds_behind=round(one.behind.seconds, 1),
        last_frame=last_frame_entry(one.last_frame),
        events=one.accounts.events,
        frames=one.accounts.frames,
        orphans=one.accounts.orphans,
    )


def aircraft_entry(one: Aircraft) -> AircraftEntry:
    return AircraftEntry(system=one.system, described=one.described, last_heard=moment(one.last_heard_utc))


def watch_entry(source: SourceReport | None) -> WatchEntry | None:
    """The watched folder or the stream, as one entry."""
    return (
        None
        if source is None
        else WatchEntry(
            kind=source.kind,
            folder=source.name,
            state=source.state,
            since=moment(source.since_utc),
            last_seen=moment(source.last_seen_utc),
            seen=source.seen,
            taken=source.taken,
            damaged=source.damaged,
            gaps=source.gaps,
        )
    )


def last_frame_entry(frame: LastFrame | None) -> LastFrameEntry | None:
    return (
        None
        if frame is None
        else LastFrameEntry(
            name=frame.name,
            outcome=cast("Outcome", frame.outcome),
            reason=frame.reason,
            covered_by=frame.covered_by,
            island=frame.island,
            time=iso_utc(frame.utc),
            seconds_to_tile=None if frame.seconds_to_tile is None else finite(frame.seconds_to_tile),
        )
    )


def condition_entry(one: Condition) -> ConditionEntry:
    return ConditionEntry(key=one.key, level=one.level, text=one.text, since=iso_utc(one.since_utc))


def notice_entry(one: NoticeRecord) -> NoticeEntry:
    return NoticeEntry(time=iso_utc(one.utc), source=one.source, level=one.level, text=one.text)


def moment(utc: float | None) -> str | None:
    return None if utc is None else iso_utc(utc)


def read_status(flight: Path, *, as_json: bool = False, now_utc: float | None = None) -> str:
    """What the last run in a folder says of itself, as text or as JSON (status.json unchanged). Raises UsageError."""
    if not inside.is_file(flight / PROGRESS_NAME, flight):  # `reprocess` has one before there is a flight
        find_flight(flight)
    path, now = flight / STATUS_NAME, now_utc or time.time()
    try:
        document = _told(path)
        progress = _told(flight / PROGRESS_NAME)
        if progress and not _is_newer(document, progress):
            path = flight / PROGRESS_NAME
            mosaic = _told(flight / MOSAIC_NAME)
            return progress_json(progress, mosaic) if as_json else _joined(_command_lines(progress, mosaic, now))
        if document:
            return json.dumps(document, indent=2) if as_json else _joined(status_lines(document, now))
        path = flight / MOSAIC_NAME
        return _of_the_map(flight, as_json=as_json)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise UsageError(
            f"{path} is not a status that this gcs-mosaic can read ({error!r}): update gcs-mosaic"
        ) from error


def _told(path: Path) -> dict[str, Any]:
    """A document; empty if it is not there."""
    try:
        return read_document(path)
    except FileNotFoundError:
        return {}


def _is_newer(status: dict[str, Any], progress: dict[str, Any]) -> bool:
    """Whether a live flight has gone on here since that command."""
    return bool(status) and _moment(status["updated"]) > _moment(progress["updated"])


def _command_lines(progress: dict[str, Any], mosaic: dict[str, Any], now_utc: float) -> list[str]:
    return [*progress_lines(progress, now_utc - _moment(progress["updated"])), *_map_lines(mosaic)]


def _of_the_map(flight: Path, *, as_json: bool) -> str:
    """Of a flight whose run has told nothing of itself, such as one of an earlier version."""
    mosaic = _told(flight / MOSAIC_NAME)
    if as_json:
        return json.dumps(mosaic, indent=2)
    if not mosaic:
        return harmless(f"{flight}: it has begun, and there is no map yet")
    return _joined(
        [f"{mosaic['flight']}: no run tells of itself; the map is of {mosaic['updated']}", *_map_lines(mosaic)]
    )


def _map_lines(mosaic: dict[str, Any]) -> list[str]:
    if not mosaic:
        return []
    held_out = {one["id"]: one.get("held_out_px") for one in mosaic["islands"]}
    return [
        f"frames: {counted(mosaic['frames'])}",
        f"triggers: {counted(mosaic['events'])}",
        *[held_out_words(island, entry) for island, entry in held_out.items() if entry],
    ]


def _joined(lines: list[str]) -> str:
    return "\n".join(harmless(line) for line in lines)


def _moment(text: str) -> float:
    """Seconds since 1970."""
    return datetime.fromisoformat(text).timestamp()


def status_lines(document: dict[str, Any], now_utc: float) -> list[str]:
    """The document of `status_document` as text, one line per item."""
    age = now_utc - _moment(document["updated"])
    hangs = age > HUNG_AFTER_S and document["state"] != "stopped"
    warning = [f"nothing was written for {age:.0f} s: the program was killed or hangs"] if hangs else []
    last, watch = document["last_frame"], document["watch"]
    return [
        f"{document['flight']}: {document['state']}, revision {document['revision']}, {document['updated']}",
        *warning,
        f"frames: {counted(document['frames'])}; {behind_words(document)}",
        f"triggers: {counted(document['events'])}",
        *[fleet_words(one) for one in document.get("aircraft", [])],
        *[held_out_words(island, entry) for island, entry in document.get("held_out_px", {}).items()],
        *([last_frame_words(last)] if last else []),
        *([f"{watch['kind']} {watch['folder']}: {'; '.join(watch_words(watch))}"] if watch else []),
        *[f"MAVLink {link['address']}: {'; '.join(link_words(link))}" for link in document["mavlink"]],
        *[f"{one['level']} since {one['since']}: {one['text']}" for one in document.get("conditions", [])],
        *[f"{notice['time']} {notice['level']}: {notice['text']}" for notice in document["notices"]],
    ]


def fleet_words(one: dict[str, Any]) -> str:
    """One of several aircraft."""
    return f"aircraft {one['system']}: frames: {counted(one['frames'])}; {behind_words(one)}; triggers: {counted(one['events'])}"


def behind_words(document: dict[str, Any]) -> str:
    """The backlog; older documents lack the seconds."""
    frames, seconds = document["frames_in_queue"], document.get("seconds_behind")
    if not frames:
        return "none waits"
    return f"the map is {frames_words(frames)}{'' if seconds is None else f', {seconds:.0f} s'} behind"


def frames_words(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def last_frame_words(last: dict[str, Any]) -> str:
    """Outcome of the last processed frame."""
    return f"last frame: {last['name']}, {last['outcome']}{covered_words(last)} at {last['time']}{latency_words(last)}"


def latency_words(last: dict[str, Any]) -> str:
    """Time from the file being complete to its tiles being on disk."""
    seconds = last["seconds_to_tile"]
    return "" if seconds is None else f", on the map {seconds:.1f} s after it came"


def covered_words(last: dict[str, Any]) -> str:
    """The frame that covers the last one, if any."""
    return f" by {last['covered_by']}" if last.get("covered_by") else ""


def watch_words(watch: dict[str, Any]) -> Iterator[str]:
    """State of the frame source, since when, and its counts."""
    yield f"{watch['state']} since {watch['since']}" if watch["since"] else str(watch["state"])
    yield counted({name: watch[name] for name in ("seen", "taken", "damaged", "gaps")})


def link_words(link: dict[str, Any]) -> Iterator[str]:
    """State of a link, and anything unusual about it."""
    yield link["state"]
    if link["silences"]:
        yield f"{link['silences']} silences"
    if link["other_triggers"]:
        left_out = ", ".join(f"{count} of system {system}" for system, count in link["other_triggers"].items())
        systems = link.get("counted")
        why = f"systems {', '.join(map(str, systems))} count" if systems else f"system {link['followed']} is followed"
        yield f"triggers left out, as {why}: {left_out}"
    if any(link["refused"].values()):
        yield f"packets refused: {counted(link['refused'])}"
    if link["sent"]:
        yield f"{link['sent']} packets sent"


def counted(account: dict[str, int]) -> str:
    """The non-empty states of an account."""
    return ", ".join(f"{count} {state}" for state, count in account.items() if count) or "none yet"


def harmless(line: str) -> str:
    """Without terminal control characters; file names are untrusted."""
    return "".join(letter if letter.isprintable() else "?" for letter in line)
