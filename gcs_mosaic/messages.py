"""Data types that flow through the program: camera events from links, frames from sources, and the shots they form.

Times named `received` are seconds on the host's monotonic clock (`time.monotonic()`); `utc` is seconds since 1970 and
for display only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from hashlib import blake2b
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

FEEDBACK_WRAP_S = 2**32 / 1e6  # ArduPilot stores CAMERA_FEEDBACK's time since boot as 32-bit microseconds
HIGHEST_SYSTEM = 255  # of MAVLink system ids; 0 is nobody's


def unwrapped(seconds: float, expected: float, wrap_s: float) -> float:
    """Unwrap `seconds` from a clock that wraps every `wrap_s`: the value nearest to `expected`."""
    return seconds + wrap_s * round((expected - seconds) / wrap_s)


def expected_system(got: int) -> str:
    """What to say of a number that is no MAVLink system id."""
    return f"expected a MAVLink system id from 1 to {HIGHEST_SYSTEM}, got {got}"


class Source(IntEnum):
    """Which message reported a shot; a higher value is more authoritative (a request may never become an image)."""

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
    """The vehicle's reported position. For display and georeferencing anchors only; never used in stitching."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None


class Teller(NamedTuple):
    """The sender of one kind of camera message. `sender` is the peer's address, where the link knows it."""

    sender: str
    system: int
    component: int
    source: Source

    def __str__(self) -> str:
        message = "CAMERA_IMAGE_CAPTURED" if self.source >= Source.IMAGE_CAPTURED_BY_AUTOPILOT else self.source.name
        return f"{message} of system {self.system}, component {self.component}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerEvent:
    """One camera message of any kind (MAVLink messages 112, 180, 263)."""

    vehicle: int  # MAVLink system id of the sender
    component: int  # MAVLink component id of the sender
    camera: int  # camera id or index from the message; 0 if it has none
    source: Source
    sequence: int | None  # the message's own counter
    received: float
    source_time: float | None  # seconds on the sender's clock
    clock: Literal["boot", "epoch", "none"]  # epoch of `source_time`
    utc: float | None
    result: CaptureResult
    file_hint: str | None  # base name, after its folder and a slash where that was told: 101MEDIA/DJI_0001.JPG
    position: Position | None
    latest: float | None = field(default=None, compare=False)  # when it was read, if `received` is an estimate
    sender: str = field(default="", compare=False)  # the peer's address, where the link knows it

    @property
    def teller(self) -> Teller:
        """Who sent it."""
        return Teller(self.sender, self.vehicle, self.component, self.source)


def content_hash(data: bytes) -> str:
    """Content identity of a file: 16-byte blake2b over the whole file, as hex."""
    return blake2b(data, digest_size=16).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedPosition:
    """Where a recording says that the camera was; for anchors of the finished map only, never used in stitching."""

    position: Position
    time_s: float  # on a clock that goes on for all frames with the same `told_by`
    told_by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One completely received image. Pixels are loaded on demand."""

    # POSIX path relative to the watched folder; an overwritten name gets "#2". Where several aircraft have a source each,
    # the aircraft's number comes first ("2/DCIM/IMG_0001.JPG"), so that two cameras may use one name.
    name: str
    path: Path  # for stream frames only the name is meaningful until the original is kept
    content_hash: str  # `content_hash` of the whole file
    size: int  # bytes
    received: float  # when the file was found complete
    modified: float  # the file's modification time, or its capture time if known, seconds since 1970
    captured: float | None = (
        None  # by the camera's own clock (EXIF), as if it showed UTC; only to find the frame's trigger
    )
    data: bytes | None = field(default=None, repr=False)  # the whole file as hashed, while in memory
    taken_for: TriggerEvent | None = None  # the event that requested it from a live stream
    vehicle: int | None = None  # MAVLink system id of the aircraft whose source brought it; None: one source for all
    picture: str | None = field(default=None, compare=False)  # see `frames.picture_hash`; None: not known
    earlier: str | None = None  # name of the frame that the same file held before
    is_whole_of_earlier: bool = False  # that was a smaller preview of this, and is the same shot
    recorded: RecordedPosition | None = field(default=None, repr=False)  # what the video it is taken from says


@dataclass(frozen=True, slots=True, kw_only=True)
class DroppedFrame:
    """A live-stream frame dropped for lack of space; its image is lost."""

    frame: Frame
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedFile:
    """A file that cannot become a frame as it is; accepted later if it becomes complete."""

    name: str
    reason: str
    vehicle: int | None = None  # as of a frame


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherFile:
    """A file of a camera that is not mapped, while another one's file of the same shot is. Never loaded; known by its name."""

    frame: Frame  # as it would be, without data
    camera: str  # as told by the names of the files, such as "_t"; empty if settings chose by a pattern
    mapped: str  # the camera that is mapped


class Topic(Enum):
    """Subject of a notice, for code that reacts to it."""

    DISK = "disk"  # writing, and remaining disk space
    PAGE = "page"  # where the map can be viewed
    FIRST_LOOK = "first look"  # every file present at the start has been inspected


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something to report to the operator (a folder was created, a link fell silent, a port is shared)."""

    source: str  # for display; code uses the topic
    level: Literal["info", "warning", "error"]
    text: str
    topic: Topic | None = None
    vehicle: int | None = None  # whose frame source says it, where each aircraft has one


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusals:
    """Packets rejected because of their signature; all 0 if no key is set."""

    unsigned: int = 0
    forged: Annotated[int, "signed with another key, or altered in transit"] = 0
    replayed: Annotated[int, "signed with our key, but not newer than the last packet"] = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Aircraft:
    """A system that sends heartbeats or triggers on a link."""

    system: int  # MAVLink system id
    described: str = ""  # autopilot and kind, such as "ArduPilot, quadrotor"
    last_heard_utc: float | None = None  # its last heartbeat, seconds since 1970; None: there was none


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """Status of a link; sent on change, and about once a second while packets arrive."""

    address: str
    state: Literal["listening", "heard", "silent", "failed"]
    last_heard_utc: float | None = None  # seconds since 1970, not an age: an age in a file would go stale
    silences: int = 0  # how often it fell silent
    followed: int | None = None  # MAVLink system id of the selected aircraft, whose triggers count
    others: tuple[tuple[int, int], ...] = ()  # (system id, ignored triggers), busiest first
    counted: tuple[int, ...] = ()  # where several aircraft fly, those whose triggers count; then none is followed
    aircraft: tuple[Aircraft, ...] = ()  # the followed one first, then those heard last
    refused: Refusals = Refusals()
    sent: int = 0  # packets; 0 unless announcing is enabled
    is_crowded: bool = False  # whether more sources trigger cameras than an aircraft has
    hears_ground_station: bool = False  # its heartbeats; those that forward others' packets may keep them to themselves


class CameraCount(NamedTuple):
    """One of several cameras that take each shot together, as told by the names of the files."""

    name: str
    files: int
    mapped: bool


SourceState = Literal["watching", "missing", "ended", "connecting", "connected", "silent", "lost"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceReport:
    """Status of a frame source: a folder is watching or missing, a stream connecting, connected, silent or lost.

    Sent when the state changes, and about once a second while the counts do. Times are seconds since 1970.
    """

    kind: Literal["folder", "stream"]
    name: str
    state: SourceState
    since_utc: float | None = None  # start of this state
    last_seen_utc: float | None = None  # arrival of the newest file or image
    seen: int = 0  # candidate files, or images received
    taken: int = 0  # accepted as frames
    damaged: int = 0
    gaps: int = 0  # how often the folder was missing or the stream silent
    reading: str = ""  # which video in the folder is being read, and how far it has come
    vehicle: int | None = None  # the aircraft that it belongs to, where each has one
    same_since_utc: float | None = None  # since when a stream has shown the same picture; None: it does not
    # A folder's files that are not taken: kinds of those that came since the start (endings, or folders of previews with a
    # slash), most first; of those there at the start that are too old, how many there are and how many came here lately.
    passed_over: tuple[tuple[str, int], ...] = ()
    left: int = 0
    left_lately: int = 0
    clock_off_s: float | None = None  # how far the times of new files are behind this computer's clock; None: not known
    cameras: tuple[CameraCount, ...] = ()  # where several cameras take each shot


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamOffer:
    """The aircraft announces a video stream (MAVLink message 269). The address may contain a password."""

    vehicle: int  # MAVLink system id of the sender
    url: str = field(repr=False)
