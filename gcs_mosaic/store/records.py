"""What the ledger stores and gives back."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from gcs_mosaic.messages import TriggerEvent
from gcs_mosaic.render.canvas import CanvasSettings
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.placement import Homography


class EventState(StrEnum):
    """Every event is exactly one of these."""

    PENDING = "pending"
    MATCHED = "matched"
    MISSING = "missing"  # its frame never came
    DUPLICATE = "duplicate"  # another message about the same shot
    FAILED = "failed"  # the camera said that it took no picture


class FrameState(StrEnum):
    """Every frame is exactly one of these."""

    PENDING = "pending"
    PLACED = "placed"
    COVERED = "covered"  # kept and not painted: a placed frame shows all that it does
    WAITING = "waiting"  # matches nothing yet
    REJECTED = "rejected"
    DUPLICATE = "duplicate"
    DAMAGED = "damaged"
    DROPPED = "dropped"  # of a live stream only


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecord:
    """Which flight a folder holds, and how its frames are painted; `started_utc` in seconds since 1970."""

    name: str
    started_utc: float
    canvas: CanvasSettings = field(default_factory=CanvasSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    id: int
    event: TriggerEvent
    state: EventState
    duplicate_of: int | None  # id of the event that counts; set exactly for duplicates
    frame: str | None  # name of the frame; set exactly for matched events


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord:
    """One frame. `content_hash`, `size` and the times are None for a file that never was whole."""

    name: str
    state: FrameState
    reason: str | None  # why it is rejected, damaged, a duplicate or dropped, for people
    had_event: bool  # False: an orphan
    original: str | None  # POSIX path relative to the output folder
    content_hash: str | None
    size: int | None  # bytes
    width: int | None  # px
    height: int | None  # px
    received: float | None  # host monotonic, seconds
    modified: float | None  # seconds since 1970


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The newest estimate of a placed frame; what is painted may still be an older one."""

    name: str
    island: int
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None = None
    inliers: int
    residual_px: float | None  # None for a founder
    neighbours: int  # frames it is linked with
    hops: int  # links to the root of its island
    corner_deviation_px: (
        float | None
    )  # standard deviation of its least certain corner; None where the matches leave it open
    homography: Homography | None = None  # where the frame was laid by a free one: then it decides, not the pose


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredRecord:
    """A frame that lies where its keyframe, a placed one, lies; `by_from_frame` takes its pixels to those of that one."""

    name: str
    by: str
    by_from_frame: Homography
    width: int  # px
    height: int  # px


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandRecord:
    id: int
    merged_into: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NoticeRecord:
    """Something that was said aloud, and when (seconds since 1970)."""

    utc: float
    source: str
    level: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EventAccount:
    pending: int = 0
    matched: int = 0
    missing: int = 0
    duplicate: int = 0
    failed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameAccount:
    pending: int = 0
    placed: int = 0
    covered: int = 0
    waiting: int = 0
    rejected: int = 0
    duplicate: int = 0
    damaged: int = 0
    dropped: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """How many events and frames are in each state. Every row of the ledger is counted exactly once."""

    events: EventAccount = EventAccount()
    frames: FrameAccount = FrameAccount()
    orphans: int = 0  # frames, in whatever state, that no event announced
