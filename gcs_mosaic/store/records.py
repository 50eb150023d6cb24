"""Record types stored in the ledger."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from gcs_mosaic.messages import Position, Teller, TriggerEvent
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.placement import Homography
from gcs_mosaic.store.told_documents import Count, EventAccount, FrameAccount, Severity


class EventState(StrEnum):
    """Every event is in exactly one of these states."""

    PENDING = "pending"
    MATCHED = "matched"
    MISSING = "missing"  # its frame never arrived
    DUPLICATE = "duplicate"  # another message about the same shot
    FAILED = "failed"  # the camera reported that it took no image


class FrameState(StrEnum):
    """Every frame is in exactly one of these states."""

    PENDING = "pending"
    PLACED = "placed"
    COVERED = "covered"  # kept but not painted: a placed frame shows the same area
    WAITING = "waiting"  # no match yet
    REJECTED = "rejected"
    DUPLICATE = "duplicate"
    DAMAGED = "damaged"
    DROPPED = "dropped"  # live streams only
    UNSTITCHED = "unstitched"  # the flight was ended before its turn; stitched when the flight is resumed


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecord:
    """The flight in a folder, and how its frames are painted; `started_utc` in seconds since 1970."""

    name: str
    started_utc: float
    canvas: CompositorSettings = field(default_factory=CompositorSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    id: int
    event: TriggerEvent
    state: EventState
    duplicate_of: int | None  # id of the event that counts; set exactly for duplicates
    frame: str | None  # name of the frame; set exactly for matched events


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord:
    """One frame. `content_hash`, `size` and the times are None for a file that was never complete."""

    name: str
    state: FrameState
    reason: str | None  # why it is rejected, damaged, a duplicate, dropped or unstitched, for display
    had_event: bool  # False: an orphan
    original: str | None  # POSIX path relative to the output folder
    content_hash: str | None
    size: int | None  # bytes
    width: int | None  # px
    height: int | None  # px
    received: float | None  # host monotonic clock, seconds
    modified: float | None  # seconds since 1970
    sharpness: float | None = None  # see `stitch.features.sharpness`; None where it was not noted
    vehicle: int | None = None  # the aircraft whose source brought it, where each has one


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The newest estimate of a placed frame; the painted one may be older."""

    name: str
    island: int
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None = None
    inliers: int
    residual_px: float | None  # None for an island's first frame
    neighbours: int  # number of linked frames
    hops: int  # links to the root of its island
    corner_deviation_px: (
        float | None
    )  # standard deviation of its least certain corner; None if the matches leave it undetermined
    homography: Homography | None = None  # placed by a free homography, which then overrides the pose
    vehicle: int | None = None  # as in `FrameRecord`
    focal_log_deviation: float | None = (
        None  # standard deviation of the log of the focal length; None while not estimated
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredRecord:
    """A frame covered by its keyframe, a placed one; `by_from_frame` maps its pixels to the keyframe's."""

    name: str
    by: str
    by_from_frame: Homography
    width: int  # px
    height: int  # px
    vehicle: int | None = None  # as in `FrameRecord`


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionRecord:
    """Where a frame is painted; enough for its outline, not for its pixels."""

    number: int  # `frames.id`, in order of arrival
    name: str
    island: int
    order: int  # capture order
    level: int
    pose: Pose
    camera: Camera
    modified: float | None  # capture time if known, else the file's; seconds since 1970
    original: str | None = None  # as in `FrameRecord`
    content_hash: str | None = None  # as in `FrameRecord`
    corner_deviation_px: float | None = None  # as in `Estimate`
    sharpness: float | None = None  # as in `FrameRecord`
    vehicle: int | None = None  # as in `FrameRecord`


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedPosition:
    """What one message said of where a frame was taken; for anchors of the finished map only."""

    frame: int  # `frames.id`
    teller: Teller
    received: float  # host monotonic clock, seconds
    source_time: float | None  # seconds on the sender's clock
    position: Position


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandRecord:
    id: int
    merged_into: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NoticeRecord:
    """A notice shown to the operator, and when (seconds since 1970)."""

    utc: float
    source: str
    level: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """How many events and frames are in each state. Every row of the ledger is counted exactly once."""

    events: EventAccount = field(default_factory=EventAccount)
    frames: FrameAccount = field(default_factory=FrameAccount)
    orphans: Count = 0  # frames that no event announced; copies of other frames and damaged files are none
