"""What the daemon says about itself while it runs: `status.json`, for the page and for `gcs-mosaic status`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

from gcs_mosaic.flight.documents import FORMAT, Document, finite, iso_utc
from gcs_mosaic.flight.records import Accounts, NoticeRecord

# listening: no frame yet; flying: frames come; idle: none for a while; settling: the last frames and the final
# painting; stopped: everything is written.
DaemonState = Literal["listening", "flying", "idle", "settling", "stopped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """One MAVLink address. Times are moments (UTC, seconds since 1970), never ages: a file does not grow older."""

    address: str
    state: Literal["listening", "heard", "silent", "failed"]
    last_heard_utc: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchStatus:
    """The watched folder (or stream)."""

    folder: str
    state: Literal["watching", "missing", "ended"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LastFrame:
    """The frame that was worked off last; `outcome` is a frame state."""

    name: str
    outcome: str
    island: int | None
    utc: float
    seconds_to_tile: float | None  # from the file being whole to its tiles being on disk
    reason: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Everything in status.json. Written at least each two seconds: an old `updated` means a daemon that hangs."""

    flight: str
    state: DaemonState
    updated_utc: float
    started_utc: float
    revision: int = 0
    mavlink: tuple[LinkStatus, ...] = ()
    watch: WatchStatus | None = None
    frames_in_queue: int = 0
    last_frame: LastFrame | None = None
    accounts: Accounts = field(default_factory=Accounts)
    notices: tuple[NoticeRecord, ...] = ()  # the newest few, oldest first


def status_document(status: Status) -> Document:
    """The content of status.json; moments are written in ISO 8601, UTC."""
    return {
        "format": FORMAT,
        "flight": status.flight,
        "state": status.state,
        "updated": iso_utc(status.updated_utc),
        "started": iso_utc(status.started_utc),
        "revision": status.revision,
        "mavlink": [link_entry(link) for link in status.mavlink],
        "watch": asdict(status.watch) if status.watch else None,
        "frames_in_queue": status.frames_in_queue,
        "last_frame": last_frame_entry(status.last_frame) if status.last_frame else None,
        "events": asdict(status.accounts.events),
        "frames": asdict(status.accounts.frames),
        "orphans": status.accounts.orphans,
        "notices": [notice_entry(notice) for notice in status.notices],
    }


def link_entry(link: LinkStatus) -> Document:
    heard = None if link.last_heard_utc is None else iso_utc(link.last_heard_utc)
    return {"address": link.address, "state": link.state, "last_heard": heard}


def last_frame_entry(frame: LastFrame) -> Document:
    return {
        "name": frame.name,
        "outcome": frame.outcome,
        "reason": frame.reason,
        "island": frame.island,
        "time": iso_utc(frame.utc),
        "seconds_to_tile": None if frame.seconds_to_tile is None else finite(frame.seconds_to_tile),
    }


def notice_entry(notice: NoticeRecord) -> Document:
    return {"time": iso_utc(notice.utc), "source": notice.source, "level": notice.level, "text": notice.text}
