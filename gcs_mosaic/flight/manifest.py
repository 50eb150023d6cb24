"""What the output folder says about itself: mosaic.json and placements.json (format 1)."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from gcs_mosaic.flight.documents import FORMAT, Document, finite, iso_utc, write_json
from gcs_mosaic.flight.heldout import held_out_entry
from gcs_mosaic.flight.records import Accounts, CoveredRecord, Estimate, FrameRecord, FrameState
from gcs_mosaic.stitch.geometry import Camera, Pose, canvas_from_frame
from gcs_mosaic.stitch.painting.grid import TILE_SIZE
from gcs_mosaic.stitch.placement import Homography
from gcs_mosaic.stitch.tearing import HeldOut

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandEntry:
    """One island as readers see it. A merged one stays listed, so that a reader knows where its tiles went."""

    id: int
    bounds: tuple[float, float, float, float]  # left, top, right, bottom in canvas units
    minzoom: int  # the coarsest level with tiles
    maxzoom: int  # the finest level with tiles
    frames: int
    merged_into: int | None = None
    held_out: HeldOut | None = None  # how good it is; None while that is not known


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """Everything that the two documents tell of one revision."""

    flight: str
    updated_utc: float
    islands: Sequence[IslandEntry]
    accounts: Accounts
    estimates: Sequence[Estimate]  # of the placed frames
    unplaced: Sequence[FrameRecord]  # rejected and waiting frames; others are passed over
    covered: Sequence[CoveredRecord] = ()
    newest: str | None = None  # of the frames that have a place


class Manifest:
    """Writes the documents of one output folder; the revision rises with every writing, also over restarts."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.revision = last_revision(out)

    def write(self, contents: Contents) -> int:
        """Write both documents, mosaic.json last; returns the new revision. After DiskFull the old one stays."""
        revision = self.revision + 1
        write_json(self.out / "placements.json", placements_document(contents, revision))
        write_json(self.out / "mosaic.json", mosaic_document(contents, revision))
        self.revision = revision
        return revision


def last_revision(out: Path) -> int:
    """The revision of the folder's mosaic.json, 0 if there is none that can be read."""
    try:
        return int(json.loads((out / "mosaic.json").read_bytes())["revision"])
    except FileNotFoundError:
        return 0
    except (OSError, ValueError, KeyError, TypeError):
        logger.warning("mosaic.json cannot be read: its revisions begin anew", exc_info=True)
        return 0


def mosaic_document(contents: Contents, revision: int) -> Document:
    """The content of mosaic.json."""
    return {
        "format": FORMAT,
        "flight": contents.flight,
        "revision": revision,
        "tile_size": TILE_SIZE,
        "islands": [island_entry(island) for island in contents.islands],
        "events": asdict(contents.accounts.events),
        "frames": asdict(contents.accounts.frames),
        "orphans": contents.accounts.orphans,
        "updated": iso_utc(contents.updated_utc),
    }


def island_entry(island: IslandEntry) -> Document:
    entry: Document = {
        "id": island.id,
        "bounds": [float(edge) for edge in island.bounds],
        "minzoom": island.minzoom,
        "maxzoom": island.maxzoom,
        "frames": island.frames,
        "held_out_px": held_out_entry(island.held_out),
        "tiles": f"tiles/{island.id}/{{z}}/{{x}}/{{y}}.jpg",
    }
    return entry if island.merged_into is None else entry | {"merged_into": island.merged_into}


def placements_document(contents: Contents, revision: int) -> Document:
    """The content of placements.json; a frame's `camera` is an index into `cameras`."""
    cameras = list(dict.fromkeys(estimate.camera for estimate in contents.estimates))
    number = {camera: index for index, camera in enumerate(cameras)}
    placed = {estimate.name: estimate for estimate in contents.estimates} if contents.covered else {}
    return {
        "format": FORMAT,
        "revision": revision,
        "cameras": [asdict(camera) for camera in cameras],
        "frames": [frame_entry(estimate, number[estimate.camera]) for estimate in contents.estimates],
        "covered": [covered_entry(covered, placed.get(covered.by)) for covered in contents.covered],
        "newest": contents.newest,
        "rejected": [
            {"name": frame.name, "reason": frame.reason} for frame in in_state(contents.unplaced, FrameState.REJECTED)
        ],
        "waiting": [{"name": frame.name} for frame in in_state(contents.unplaced, FrameState.WAITING)],
    }


def frame_entry(estimate: Estimate, camera: int) -> Document:
    deviation = estimate.corner_deviation_px
    return {
        "name": estimate.name,
        "island": estimate.island,
        "camera": camera,
        "canvas_from_frame": estimate.homography or homography(estimate.pose, estimate.camera),
        "width": estimate.camera.width,
        "height": estimate.camera.height,
        "inliers": estimate.inliers,
        "residual_px": None if estimate.residual_px is None else finite(estimate.residual_px),
        "neighbours": estimate.neighbours,
        "hops": estimate.hops,
        "corner_deviation_px": None if deviation is None else finite(deviation),
    }


def covered_entry(covered: CoveredRecord, keyframe: Estimate | None) -> Document:
    """A frame that follows its keyframe, wherever that lies now."""
    return {
        "name": covered.name,
        "covered_by": covered.by,
        "island": keyframe.island if keyframe else None,
        "canvas_from_frame": followed(keyframe.pose, keyframe.camera, covered.by_from_frame) if keyframe else None,
        "width": covered.width,
        "height": covered.height,
    }


@lru_cache(maxsize=65536)
def followed(pose: Pose, camera: Camera, by_from_frame: Homography) -> list[list[float]]:
    """`canvas_from_frame` of a covered frame, whose keyframe lies at this pose."""
    canvas_from_covered = canvas_from_frame(pose, camera) @ np.array(by_from_frame)
    rows: list[list[float]] = (canvas_from_covered / canvas_from_covered[2, 2]).tolist()
    return rows


@lru_cache(maxsize=8192)
def homography(pose: Pose, camera: Camera) -> list[list[float]]:
    """`canvas_from_frame` as nested lists; kept, because from one revision to the next most frames have not moved."""
    rows: list[list[float]] = canvas_from_frame(pose, camera).tolist()
    return rows


def in_state(frames: Iterable[FrameRecord], state: FrameState) -> list[FrameRecord]:
    return [frame for frame in frames if frame.state is state]
