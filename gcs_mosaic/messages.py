"""What flows in: camera events from the link, frames from a source, and the shots they make together.

All times named `received` are seconds on the host's monotonic clock (`time.monotonic()`); `utc` is seconds since 1970
and only ever shown.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from hashlib import blake2b
from pathlib import Path
from typing import Literal

FEEDBACK_WRAP_S = 2**32 / 1e6  # ArduPilot counts CAMERA_FEEDBACK's time since boot in 32 bits of microseconds


def unwrapped(seconds: float, expected: float, wrap_s: float) -> float:
    """`seconds` on a clock that begins anew every `wrap_s`, as one that goes on: what is nearest to `expected`."""
    return seconds + wrap_s * round((expected - seconds) / wrap_s)


class Source(IntEnum):
    """Who told us of a shot; a higher value is the better witness (a request may never become a picture)."""

    CAMERA_TRIGGER = 1
    CAMERA_FEEDBACK = 2
    IMAGE_CAPTURED_BY_AUTOPILOT = 3
    IMAGE_CAPTURED_BY_CAMERA = 4


class CaptureResult(Enum):
    TAKEN = "taken"
    FAILED = "failed"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """Where the vehicle says it was. A note for people and for anchors; it never reaches the stitching."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerEvent:
    """One camera message, whatever its kind (MAVLink messages 112, 180, 263)."""

    vehicle: int  # MAVLink system id of the sender
    component: int  # MAVLink component id of the sender
    camera: int  # camera id or index as the message gives it; 0 where it gives none
    source: Source
    sequence: int | None  # the message's own counter
    received: float
    source_time: float | None  # seconds on the sender's clock
    clock: Literal["boot", "epoch", "none"]  # what `source_time` counts from
    utc: float | None
    result: CaptureResult
    file_hint: str | None  # base name only, already stripped of any path
    position: Position | None


def content_hash(data: bytes) -> str:
    """What makes two files the same picture, every byte: hex of blake2b with 16 bytes over the whole file."""
    return blake2b(data, digest_size=16).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One image that has come completely. Pixels are loaded when they are wanted."""

    name: str  # POSIX path relative to the watched folder; an overwritten name gets "#2"
    path: Path  # of a stream's frame only its name counts, until it is kept
    content_hash: str  # `content_hash` of the whole file
    size: int  # bytes
    received: float  # when the file was found whole
    modified: float  # the file's own time, or that of capture where it is known, seconds since 1970
    data: bytes | None = field(default=None, repr=False)  # the whole file as it was hashed, while it is in memory
    taken_for: TriggerEvent | None = None  # what asked a live stream for it


@dataclass(frozen=True, slots=True, kw_only=True)
class DroppedFrame:
    """A frame of a live stream for which there was no room; its picture is gone."""

    frame: Frame
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedFile:
    """A file that will not become a frame as it is; it is taken later if it becomes whole."""

    name: str
    reason: str


class Topic(Enum):
    """What a notice is about, where somebody acts on it."""

    DISK = "disk"  # writing, and what is left to write on
    PAGE = "page"  # where the map can be looked at
    FIRST_LOOK = "first look"  # every file that was there at the start has been looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something a source wants said aloud (a folder was created, a link fell silent, a port is shared)."""

    source: str  # for people; what programs go by is the topic
    level: Literal["info", "warning", "error"]
    text: str
    topic: Topic | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusals:
    """Packets that were not believed because of their signature; all are 0 where no key is set."""

    unsigned: int = 0
    forged: int = 0  # signed, but not with our key, or changed on the way
    replayed: int = 0  # signed with our key, but not newer than what was heard before


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """How a link is; said when it changes, and about each second while something is heard."""

    address: str
    state: Literal["listening", "heard", "silent", "failed"]
    last_heard_utc: float | None = None  # seconds since 1970: a moment, never an age, for a file does not grow older
    silences: int = 0  # how often it has fallen silent
    followed: int | None = None  # MAVLink system id of the aircraft whose triggers count
    others: tuple[tuple[int, int], ...] = ()  # (system id, triggers left out), the busiest first
    refused: Refusals = Refusals()
    sent: int = 0  # packets; 0 unless announcing was asked for


SourceState = Literal["watching", "missing", "ended", "connecting", "connected", "silent", "lost"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceReport:
    """How the source of frames is: a folder is watching or missing, a stream connecting, connected, silent or lost.

    Said when the state changes, and about each second while the numbers do. Times are seconds since 1970.
    """

    kind: Literal["folder", "stream"]
    name: str
    state: SourceState
    since_utc: float | None = None  # when this state began
    last_seen_utc: float | None = None  # when the newest file or picture came
    seen: int = 0  # files that may be frames, or pictures received
    taken: int = 0  # as frames
    damaged: int = 0
    gaps: int = 0  # times that the folder was missing or the stream brought nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamOffer:
    """The aircraft says where a video stream of its is (MAVLink message 269). The address may hold a password."""

    vehicle: int  # MAVLink system id of the sender
    url: str = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """The unit of work: a frame and, where one is known, the event that announced it."""

    event: TriggerEvent | None
    frame: Frame
