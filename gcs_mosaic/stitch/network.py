"""The network of frames: which frames there are, how they were linked by matches, and where they lie.

One network holds all islands. Frames are numbered in the order in which they came; numbers never change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.geometry import Camera, Pose, footprint
from gcs_mosaic.stitch.matching.features import Features
from gcs_mosaic.stitch.matching.registration import Registration, well_spread
from gcs_mosaic.stitch.relief.displacement import ReliefDisplacement

Array = NDArray[np.float64]

NOWHERE = -1  # the island of a frame that is not placed


@dataclass(slots=True)
class FrameState:
    """All that is kept of a frame. `pose` is None until it is placed; `held` is the pose it is drawn at."""

    name: str
    features: Features
    camera: int
    pose: Pose | None = None
    held: tuple[Pose, Camera] | None = None
    inliers: dict[int, int] = field(default_factory=dict)  # independent inliers by linked frame
    relief: ReliefDisplacement | None = None
    residual_px: float = math.nan  # median over its matches, full-resolution pixels
    hops: int = 0  # links between it and its island's root, along the shortest way
    corner_deviation_px: float = 0.0  # of its least certain corner, full-resolution pixels; relative to the root


@dataclass(frozen=True, slots=True)
class Link:
    """Matches of two frames: full-resolution pixels (m, 2) in each of a few, and which features (k, 2) all of them are."""

    pixels_a: Array
    pixels_b: Array
    features: NDArray[np.uint32]


class Network:
    """Frames, cameras and links.

    `islands` (n,): each frame's island, NOWHERE for those that are not placed. `boxes` (n, 4): bounding box of each placed
    frame's footprint, NaN for the others. Both are arrays so that a question about all frames costs next to nothing.
    `roots`: the frame that founded each island, by the island's number.
    """

    def __init__(self, first_focal: float, matches_per_link: int) -> None:
        self.frames: list[FrameState] = []
        self.cameras: list[Camera] = []
        self.links: dict[tuple[int, int], Link] = {}
        self.islands: NDArray[np.intp] = np.empty(0, np.intp)
        self.boxes: Array = np.empty((0, 4))
        self.roots: dict[int, int] = {}
        self.moved: set[int] = set()  # frames put somewhere since whoever follows them last cleared this
        self._first_focal = first_focal
        self._matches_per_link = matches_per_link

    def append(self, name: str, features: Features) -> int:
        """Take in a frame, not yet placed; a size not seen before is a camera of its own."""
        sizes = [(camera.width, camera.height) for camera in self.cameras]
        size = (features.width, features.height)
        if size not in sizes:
            self.cameras.append(Camera(*size, focal=self._first_focal))
            sizes.append(size)
        self.frames.append(FrameState(name, features, sizes.index(size)))
        self.islands = np.append(self.islands, NOWHERE)
        self.boxes = np.concatenate([self.boxes, np.full((1, 4), np.nan)])
        return len(self.frames) - 1

    def put(self, frame: int, pose: Pose, island: int) -> None:
        """Place a frame, or move it."""
        self.frames[frame].pose, self.islands[frame] = pose, island
        self.boxes[frame] = box_of(pose, self.camera_of(frame))
        self.roots.setdefault(island, frame)
        self.moved.add(frame)

    def take_back(self, frame: int) -> None:
        """Make a frame unplaced and unlinked again."""
        state = self.frames[frame]
        for other in list(state.inliers):
            self.unlink(frame, other)
        state.pose = state.held = state.relief = None
        if self.roots.get(int(self.islands[frame])) == frame:
            del self.roots[int(self.islands[frame])]
        self.islands[frame] = NOWHERE
        self.boxes[frame] = np.nan
        self.moved.discard(frame)

    def link(self, a: int, b: int, registration: Registration) -> None:
        """Keep what registered frame a with frame b, thinned to well-spread matches."""
        chosen = well_spread(registration.pixels_a, self._matches_per_link)
        self.unlink(a, b)
        self.links[a, b] = Link(
            registration.pixels_a[chosen], registration.pixels_b[chosen], registration.features.astype(np.uint32)
        )
        self.frames[a].inliers[b] = self.frames[b].inliers[a] = registration.independent_inliers

    def unlink(self, a: int, b: int) -> None:
        for first, second in ((a, b), (b, a)):
            self.links.pop((first, second), None)
            self.frames[first].inliers.pop(second, None)

    def camera_of(self, frame: int) -> Camera:
        return self.cameras[self.frames[frame].camera]

    def pose_of(self, frame: int) -> Pose:
        pose = self.frames[frame].pose
        assert pose is not None, "only placed frames have a pose"
        return pose

    def island_of(self, frame: int) -> int:
        assert self.islands[frame] != NOWHERE, "only placed frames lie on an island"
        return int(self.islands[frame])

    def placed(self) -> NDArray[np.intp]:
        """Frames that lie on any island, in the order in which they came."""
        return np.flatnonzero(self.islands != NOWHERE)

    def members(self, island: int) -> NDArray[np.intp]:
        """Frames of an island, in the order in which they came."""
        return np.flatnonzero(self.islands == island)

    def count_members(self, island: int) -> int:
        return int(np.count_nonzero(self.islands == island))

    def elsewhere(self, island: int) -> NDArray[np.intp]:
        """Placed frames of the other islands."""
        return np.flatnonzero((self.islands != NOWHERE) & (self.islands != island))

    def count_placed(self, camera: int, most: int) -> int:
        """How many frames of a camera are placed; counting ends at `most`."""
        of_camera = (frame for frame in self.frames if frame.camera == camera and frame.pose is not None)
        return sum(1 for _ in islice(of_camera, most))

    def frame_counts(self) -> dict[int, int]:
        """Placed frames by island."""
        numbers, counts = np.unique(self.islands[self.placed()], return_counts=True)
        return dict(zip(numbers.tolist(), counts.tolist(), strict=True))


def box_of(pose: Pose, camera: Camera) -> Array:
    """Bounding box (x0, y0, x1, y1) of what a frame sees of the canvas; NaN where it sees no ground."""
    outline = footprint(pose, camera, per_side=3)
    outline = outline[np.isfinite(outline).all(axis=1)]
    if not len(outline):
        return np.full(4, np.nan)
    return np.concatenate([outline.min(axis=0), outline.max(axis=0)])


def centres(boxes: Array) -> Array:
    """Middles (n, 2) of boxes (n, 4)."""
    return (boxes[:, :2] + boxes[:, 2:]) / 2
