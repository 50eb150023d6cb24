"""What the documents of the output folder tell (format 1): units and limits stand here, and nowhere else.

Light, for the page's process, which describes the documents and need not load what writes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from gcs_mosaic.messages import HIGHEST_SYSTEM, Refusals, SourceState
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, HALF_SPAN
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.store.told_islands import MOST_ISLANDS

FORMAT: Literal[1] = 1  # of every JSON file in the output folder; raised on incompatible changes

Moment = Annotated[str, Limits(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$"), "ISO 8601, UTC"]
Count = Annotated[int, Limits(least=0)]
Pixels = Annotated[float | None, Limits(least=0), "px; null: none, or endless"]
System = Annotated[int, Limits(least=0, most=HIGHEST_SYSTEM), "MAVLink system id"]
Orphans = Annotated[Count, "frames that no event announced, without copies of others and damaged files"]
Seconds = Annotated[float, Limits(least=0), "seconds since the first frame that waits came"]
IslandId = Annotated[int, Limits(least=0, most=MOST_ISLANDS)]
Level = Annotated[int, Limits(least=0, most=FINEST_LEVEL), "of the tiles"]
Edge = Annotated[float, Limits(least=-2 * HALF_SPAN, most=2 * HALF_SPAN)]
Size = Annotated[int, Limits(least=1), "px"]
Row = tuple[float, float, float]
Matrix = Annotated[tuple[Row, Row, Row], "homography, row by row, from pixels of the frame's original"]

# listening: no frame yet; flying: frames arriving; idle: none for a while; settling: last frames and final
# painting; stopped: everything is written.
DaemonState = Literal["listening", "flying", "idle", "settling", "stopped"]
Severity = Literal["info", "warning", "error"]
# As `FrameState`.
Outcome = Literal[
    "pending", "placed", "covered", "waiting", "rejected", "duplicate", "damaged", "dropped", "unstitched"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class EventAccount:
    """How many events are in each state."""

    pending: Count = 0
    matched: Count = 0
    missing: Count = 0
    duplicate: Count = 0
    failed: Count = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameAccount:
    """How many frames are in each state."""

    pending: Count = 0
    placed: Count = 0
    covered: Count = 0
    waiting: Count = 0
    rejected: Count = 0
    duplicate: Count = 0
    damaged: Count = 0
    dropped: Count = 0
    unstitched: Count = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutEntry:
    """How far the map tears matches apart that took no part in its estimation, in pixels of the island's median frame."""

    median: Pixels
    p95: Pixels
    matches: Count


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandDocument:
    """An island; one that was merged stays listed, to say into which."""

    id: IslandId
    bounds: Annotated[tuple[Edge, Edge, Edge, Edge], "left, top, right, bottom in canvas units"]
    minzoom: Level
    maxzoom: Level
    frames: Count
    held_out_px: HeldOutEntry | None
    tiles: Annotated[str, "where they are, with {z}, {x} and {y}"]
    merged_into: IslandId | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MosaicDocument:
    """mosaic.json: the map at a revision."""

    format: Literal[1]
    flight: str
    revision: Count
    tile_size: Annotated[int, "px"]
    islands: Sequence[IslandDocument]
    events: EventAccount
    frames: FrameAccount
    orphans: Orphans
    updated: Moment


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEntry:
    """A frame that has a place, without its lens. `vehicle`: its aircraft, where each has a source of its own."""

    name: str
    vehicle: System | None = None
    island: Count
    canvas_from_frame: Matrix
    width: Size
    height: Size
    inliers: Count
    residual_px: Pixels
    neighbours: Annotated[Count, "linked frames"]
    hops: Annotated[Count, "links to the island's first frame"]
    corner_deviation_px: Annotated[Pixels, "standard deviation of its least certain corner"]
    focal_log_deviation: Annotated[float | None, Limits(least=0), "standard deviation of the focal length's logarithm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedEntry(FrameEntry):
    """A frame that has a place."""

    camera: Annotated[Count, "index in `cameras`"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredEntry:
    """A frame that shows what its keyframe shows, and moves with it."""

    name: str
    vehicle: System | None = None
    covered_by: Annotated[str, "the keyframe's name"]
    keyframe_from_frame: Matrix
    island: Count | None
    canvas_from_frame: Matrix | None
    width: Size
    height: Size


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedEntry:
    """A frame that is not on the map, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingEntry:
    """A frame that matches nothing yet."""

    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementsHead:
    """Of which revision the lists are, the newest frame of all and of each aircraft, and the lenses."""

    format: Literal[1]
    revision: Count
    newest: str | None
    newest_of: Annotated[Mapping[str, str] | None, "by the aircraft's MAVLink system id"] = None
    cameras: Sequence[Camera]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementsDocument(PlacementsHead):
    """placements.json: every frame; or a line of placements.jsonl: those of which there is news at a revision."""

    frames: Sequence[PlacedEntry]
    covered: Sequence[CoveredEntry]
    rejected: Sequence[RejectedEntry]
    waiting: Sequence[WaitingEntry]


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalHead:
    """The first line of placements.jsonl; what has changed up to the revision `since` is not in the lines that follow."""

    format: Literal[1]
    since: Count


@dataclass(frozen=True, slots=True, kw_only=True)
class NoticeEntry:
    """What has happened."""

    time: Moment
    source: str
    level: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionEntry:
    """What is so now and wants to be known, in a sentence; `key` tells them apart."""

    key: str
    level: Severity
    text: str
    since: Moment


@dataclass(frozen=True, slots=True, kw_only=True)
class LastFrameEntry:
    """The frame that was processed last, and its state."""

    name: str
    outcome: Outcome
    reason: str | None
    covered_by: Annotated[str | None, "the placed frame that shows the same"]
    island: Count | None
    time: Moment
    seconds_to_tile: Annotated[float | None, "from the file being complete to its tiles being on the disk"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchEntry:
    """A watched folder, or a stream: its state and since when, what came last, and counts of files or images."""

    kind: Literal["folder", "stream"]
    folder: Annotated[str, "or address"]
    state: SourceState
    since: Moment | None
    last_seen: Moment | None
    seen: Count
    taken: Annotated[Count, "as frames"]
    damaged: Count
    gaps: Annotated[Count, "how often the folder was missing, or the stream silent"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftEntry:
    """A system that sends heartbeats or triggers on a link."""

    system: System
    described: Annotated[str, "autopilot and kind"]
    last_heard: Moment | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkEntry:
    """A MAVLink link. `followed`: the aircraft whose triggers count; `counted`: those, where several fly."""

    address: str
    state: Literal["listening", "heard", "silent", "failed"]
    last_heard: Moment | None
    silences: Count
    followed: System | None
    counted: Sequence[System] | None = None
    aircraft: Sequence[AircraftEntry]
    other_triggers: Annotated[Mapping[str, int], "triggers that do not count, by system id"]
    refused: Refusals
    sent: Annotated[Count, "packets"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetMemberEntry:
    """One of several aircraft."""

    system: System
    watch: WatchEntry | None
    frames_in_queue: Count
    seconds_behind: Seconds
    last_frame: LastFrameEntry | None
    events: EventAccount
    frames: FrameAccount
    orphans: Orphans


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusDocument:
    """status.json: the flight now. It is written every two seconds or more often: an old `updated` means a hung program."""

    format: Literal[1]
    flight: str
    state: DaemonState
    updated: Moment
    started: Moment
    revision: Count
    mavlink: Sequence[LinkEntry]
    watch: WatchEntry | None
    frames_in_queue: Count
    seconds_behind: Seconds
    last_frame: LastFrameEntry | None
    events: EventAccount
    frames: FrameAccount
    orphans: Orphans
    aircraft: Annotated[Sequence[FleetMemberEntry] | None, "where several fly"] = None
    held_out_px: Annotated[Mapping[str, HeldOutEntry], "by island"]
    conditions: Annotated[Sequence[ConditionEntry], "the worst first"]
    notices: Annotated[Sequence[NoticeEntry], "the newest few, oldest first"]


CommandName = Literal["stitch", "merge", "replay", "reprocess"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgressDocument:
    """progress.json: how far a command is. It is written each second: an old `updated` of a running one means a hung program."""

    format: Literal[1]
    command: CommandName
    state: Literal["running", "ended"]
    started: Moment
    updated: Moment
    doing: Annotated[str, "in words"]
    done: Annotated[Count, "steps of it"]
    of: Annotated[Count | None, "as many steps as there are, where that is known"]
    seconds_left: Annotated[float | None, Limits(least=0)]
