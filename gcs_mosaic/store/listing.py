"""The frames of a flight by outcome, as in placements.json; entries are cached as text, so that listing all is fast."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TypeAlias, cast

import numpy as np

from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_frame
from gcs_mosaic.stitch.graph.placement import Homography
from gcs_mosaic.store.documents import compact, finite
from gcs_mosaic.store.records import CoveredRecord, Estimate
from gcs_mosaic.store.told_documents import (
    FORMAT,
    CoveredEntry,
    FrameEntry,
    Matrix,
    PlacementsHead,
    RejectedEntry,
    WaitingEntry,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNews:
    """News about some frames; replaces earlier news about them. `newest` is for the whole flight."""

    estimates: Sequence[Estimate] = ()  # of placed frames
    covered: Sequence[CoveredRecord] = ()
    rejected: Mapping[str, str] = field(default_factory=dict)  # reason by name
    waiting: Sequence[str] = ()
    newest: str | None = None  # the most recently arrived frame that has a place
    newest_of: Mapping[int, str] = field(default_factory=dict)  # ... of each aircraft that has a source of its own


@dataclass(frozen=True, slots=True)
class _Placed:
    estimate: Estimate
    text: str  # its entry without the camera, whose index differs between documents


@dataclass(frozen=True, slots=True)
class _Unplaced:
    kind: str  # the list that contains it
    text: str


_Entry: TypeAlias = _Placed | CoveredRecord | _Unplaced


class Listing:
    """All published news about the frames of a flight."""

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}  # in order of first news
        self._newest: str | None = None
        self._newest_of: Mapping[int, str] = {}

    def tell(self, news: FrameNews) -> list[str]:
        """Add news; returns the names of the frames concerned."""
        told: dict[str, _Entry] = {}
        for name, reason in news.rejected.items():
            told[name] = _Unplaced("rejected", compact(RejectedEntry(name=name, reason=reason)))
        for name in news.waiting:
            told[name] = _Unplaced("waiting", compact(WaitingEntry(name=name)))
        for estimate in news.estimates:
            told[estimate.name] = _Placed(estimate, compact(frame_entry(estimate)))
        for covered in news.covered:
            told[covered.name] = covered
        self._entries |= told
        self._newest, self._newest_of = news.newest, news.newest_of
        return list(told)

    def text(self, revision: int, names: Iterable[str] | None = None) -> str:
        """The content of placements.json; limited to `names`, a line of placements.jsonl.

        A frame's `camera` is an index into `cameras`.
        """
        lists: dict[str, list[str]] = {"frames": [], "covered": [], "rejected": [], "waiting": []}
        cameras: dict[Camera, int] = {}
        for name in self._entries if names is None else names:
            match self._entries[name]:
                case _Placed(estimate, text):
                    camera = cameras.setdefault(estimate.camera, len(cameras))
                    lists["frames"].append(f'{{"camera":{camera},{text[1:]}')
                case _Unplaced(kind, text):
                    lists[kind].append(text)
                case covered:
                    lists["covered"].append(compact(covered_entry(covered, self._estimate(covered.by))))
        head = PlacementsHead(
            format=FORMAT,
            revision=revision,
            newest=self._newest,
            newest_of={str(one): name for one, name in self._newest_of.items()} or None,
            cameras=[*cameras],
        )
        parts = (f'"{kind}":[{",".join(texts)}]' for kind, texts in lists.items())
        return f"{compact(head)[:-1]},{','.join(parts)}}}"

    def _estimate(self, name: str) -> Estimate | None:
        entry = self._entries.get(name)
        return entry.estimate if isinstance(entry, _Placed) else None


def frame_entry(estimate: Estimate) -> FrameEntry:
    """A placed frame's entry, without its camera."""
    deviation = estimate.corner_deviation_px
    placed = canvas_from_frame(estimate.pose, estimate.camera).tolist()
    return FrameEntry(
        name=estimate.name,
        vehicle=estimate.vehicle,
        island=estimate.island,
        canvas_from_frame=cast("Matrix", estimate.homography or placed),
        width=estimate.camera.width,
        height=estimate.camera.height,
        inliers=estimate.inliers,
        residual_px=None if estimate.residual_px is None else finite(estimate.residual_px),
        neighbours=estimate.neighbours,
        hops=estimate.hops,
        corner_deviation_px=None if deviation is None else finite(deviation),
        focal_log_deviation=estimate.focal_log_deviation,
    )


def covered_entry(covered: CoveredRecord, keyframe: Estimate | None) -> CoveredEntry:
    """A covered frame's entry; it moves with its keyframe."""
    return CoveredEntry(
        name=covered.name,
        vehicle=covered.vehicle,
        covered_by=covered.by,
        keyframe_from_frame=cast("Matrix", covered.by_from_frame),
        island=keyframe.island if keyframe else None,
        canvas_from_frame=followed(keyframe.pose, keyframe.camera, covered.by_from_frame) if keyframe else None,
        width=covered.width,
        height=covered.height,
    )


@lru_cache(maxsize=65536)
def followed(pose: Pose, camera: Camera, by_from_frame: Homography) -> Matrix:
    """`canvas_from_frame` of a covered frame for this keyframe pose; cached, because most keyframes do not move."""
    canvas_from_covered = canvas_from_frame(pose, camera) @ np.array(by_from_frame)
    return cast("Matrix", (canvas_from_covered / canvas_from_covered[2, 2]).tolist())
