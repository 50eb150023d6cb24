"""View graph: all frames, their links by matches, and their poses.

One graph holds all islands and is the only state that placement keeps: the modules around it decide and keep none. Frames are
numbered in order of arrival; numbers never change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from gcs_mosaic.stitch.arrays import (
    AnyPairsNx2,
    Box4,
    BoxesNx4,
    FeaturePairsNx2,
    Indices,
    Mask,
    Points32Nx2,
    PointsNx2,
    SquareMatrix,
)
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, footprint
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.retrieval import RetrievalIndex
from gcs_mosaic.stitch.features.shelf import Shelve, Shelved
from gcs_mosaic.stitch.graph.waiting import WaitingFrames
from gcs_mosaic.stitch.registration.held_out import clear_of, held_out, held_out_doubtful
from gcs_mosaic.stitch.registration.outcome import Registration, well_spread
from gcs_mosaic.stitch.transaction import Kept, Snapshot

CameraNumber = int  # frames of one size, of one aircraft, were taken by one camera
Aircraft = int | None  # its number where several are told apart

NOWHERE = -1  # the island of a frame that is not placed
# Share of the cells around a correctly placed frame that matches confirm (0.9 over fields, 0.5 to 0.9 in woods), and its weight
# in cells, two or three frames: until a flight has shown its own share.
FIRST_SHARE, FIRST_CELLS = 0.8, 60
LEAST_SHARE, MOST_SHARE = 0.5, 0.85  # its bounds: where islands meet, poses are rough
LENS_KNOWN = 5  # frames after which an island knows a lens well enough to judge residuals and to inform others
NO_POINTS: Points32Nx2 = np.empty((0, 2), np.float32)
NO_PAIRS: FeaturePairsNx2 = np.empty((0, 2), np.uint16)
NO_INLIERS: Mapping[int, int] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class GraphFrame:
    """Everything known of a frame. `pose` is None until it is placed; `drawn` is the pose it is drawn at."""

    name: str
    features: Features
    camera: CameraNumber
    pose: Pose | None = None
    drawn: tuple[Pose, Camera] | None = None
    inliers: Mapping[int, int] = field(default_factory=lambda: NO_INLIERS)  # independent inliers by linked frame
    relief: ReliefDisplacement | None = None
    residual_px: float = math.nan  # median over its matches, full-resolution pixels
    hops: int = 0  # links on the shortest path to its island's root
    corner_deviation_px: float = 0.0  # of its least certain corner, full-resolution pixels; relative to the root
    matched_in_folded: bytes = b""  # bits: which of its features its folded links have matched


@dataclass(frozen=True, slots=True)
class Link:
    """Matches of two frames: full-resolution pixels (m, 2) in each for a selection, and feature indices (k, 2) for all.

    `held_out` (n, 2): inliers, and `doubtful` (d, 2): tentative matches, neither used for placement; see
    `registration.held_out`. A link that is `folded` has none of the three.
    """

    pixels_a: PointsNx2 | Points32Nx2
    pixels_b: PointsNx2 | Points32Nx2
    features: FeaturePairsNx2
    held_out: FeaturePairsNx2
    doubtful: FeaturePairsNx2

    def folded(self) -> Link:
        """The same with nothing but what adjustments use. Pixels of features are of single precision, and kept so."""
        pixels_a, pixels_b = (pixels.astype(np.float32) for pixels in (self.pixels_a, self.pixels_b))
        return Link(pixels_a, pixels_b, NO_PAIRS, NO_PAIRS, NO_PAIRS)


@dataclass(frozen=True, slots=True)
class Bridge:
    """Two frames of different islands that were registered with each other."""

    frame_a: int
    frame_b: int
    registration: Registration  # of frame a with frame b

    def turned(self) -> Bridge:
        """The same bridge with the sides exchanged."""
        return Bridge(self.frame_b, self.frame_a, self.registration.turned())


@dataclass(frozen=True, slots=True)
class Lens:
    """What an island's frames have shown of a camera: `information` (5, 5), the inverse covariance of its terms as in
    `projection.lens_row`; None while not estimated. `refused`: the matches pulled it to where no lens is believed, and some of
    its terms are those of an ordinary one."""

    camera: Camera
    information: SquareMatrix | None = None
    refused: bool = False

    @property
    def focal_log_deviation(self) -> float | None:
        """Standard deviation of the log of the focal length: nearly a share of it. None while not estimated."""
        return None if self.information is None else math.sqrt(np.linalg.inv(self.information)[0, 0])


class ViewGraph(Kept):
    """Frames, lenses, links and islands.

    `islands` (n,): each frame's island, NOWHERE if not placed. `cameras` (n,): each frame's camera. `boxes` (n, 4): bounding
    box of each placed frame's footprint, else NaN. They are arrays so that queries over all frames are cheap. `roots`: founding
    frame by island. `merged_into`: by island, the island it was merged into, or None. `lenses`: by island and camera, because
    an island knows a lens only from its own frames. `unevenness`: by island, the standard deviation of its heights in flying
    heights, once known. `shelve`: where the large arrays of frames' features go.
    """

    def __init__(self, first_focal: float, matches_per_link: int, shelve: Shelve | None = None) -> None:
        self.frames: list[GraphFrame] = []
        self.numbers: dict[str, int] = {}  # by the frame's name
        self.sizes: list[Camera] = []  # by camera: its size, and the lens expected of any
        self.aircraft_of: list[Aircraft] = []  # by camera: what carries it
        self.lenses: dict[tuple[int, CameraNumber], Lens] = {}
        self.links: dict[tuple[int, int], Link] = {}
        self.islands: Indices = np.empty(0, np.intp)
        self.cameras: Indices = np.empty(0, np.intp)
        self.boxes: BoxesNx4 = np.empty((0, 4))
        self.roots: dict[int, int] = {}
        self.merged_into: list[int | None] = []
        self.unevenness: dict[int, float] = {}
        self.bridges: list[Bridge] = []
        # Pairs of frames compared when idle, smaller number first, with the poses at which they could not be connected despite
        # much in common; None if they have little.
        self.compared: dict[tuple[int, int], tuple[Pose | None, Pose | None] | None] = {}
        self.looked_again: set[tuple[int, int]] = set()  # pairs that were looked at a second time, smaller number first
        self.frames_to_ask: list[int] = []  # to be compared next,
        self.asked_when: tuple[int, int, int] | None = None  # selected at this state of knowledge
        # Around accepted frames: number of cells that should have been confirmed, and that were.
        self.cells_expected, self.cells_confirmed = FIRST_CELLS, FIRST_CELLS * FIRST_SHARE
        # By pairs of matched frames, the latest last: which of the first's cells the other should show, and which agree, as bits.
        self.found_again: dict[tuple[int, int], tuple[bytes, bytes]] = {}
        self.waiting = WaitingFrames()
        self.retrieval = RetrievalIndex(shelve)
        self.last_placed = 0  # where the search for the next frame begins
        self.placed_before: int | None = None  # if the last frame was placed after this one, without a turn in between
        self.order = -1  # of the last frame examined, in capture order
        self.aircraft: Aircraft = None  # that took it
        # By aircraft and capture order of its earlier frames: the nearest placed frame.
        self._seen_at: dict[tuple[Aircraft, int], int] = {}
        self.moved: set[int] = set()  # frames placed or moved since the set was last cleared
        self._first_focal = first_focal
        self._matches_per_link = matches_per_link
        self._shelve = shelve

    def load(self, saved: Snapshot) -> None:
        super().load(saved)
        self.retrieval.fill(frame.features for frame in self.frames)

    def append(self, name: str, features: Features) -> int:
        """Add a frame, not yet placed; a new frame size of an aircraft is a new camera."""
        features = features if self._shelve is None else features.shelved(self._shelve)
        number, camera = len(self.frames), self.camera_with(features.width, features.height, self.aircraft)
        self.frames.append(GraphFrame(name, features, camera))
        self.numbers[name] = number
        self.islands = np.append(self.islands, NOWHERE)
        self.cameras = np.append(self.cameras, camera)
        self.boxes = np.concatenate([self.boxes, np.full((1, 4), np.nan)])
        self.retrieval.add(features)
        return number

    def camera_with(self, width: int, height: int, aircraft: Aircraft) -> CameraNumber:
        """The camera of an aircraft that makes frames of this size; a new one if there is none."""
        known = zip(self.sizes, self.aircraft_of, strict=True)
        cameras = [(camera.width, camera.height, carrier) for camera, carrier in known]
        if (width, height, aircraft) in cameras:
            return cameras.index((width, height, aircraft))
        self.sizes.append(Camera(width, height, focal=self._first_focal))
        self.aircraft_of.append(aircraft)
        return len(cameras)

    def turn_to(self, order: int, aircraft: Aircraft = None) -> None:
        """Set the capture index of the frame placed next, and what took it. If it does not follow the last one, the search for it
        begins at the frame of its aircraft nearest in time."""
        self._seen_at[self.aircraft, self.order] = self.last_placed
        if order != self.order + 1 or aircraft != self.aircraft:
            seen = {other: place for (one, other), place in self._seen_at.items() if one == aircraft}
            nearest = min(seen, key=lambda other: (abs(other - order), other), default=None)
            if nearest is not None:  # that of a new aircraft begins where the last frame is
                self.last_placed, self.placed_before = seen[nearest], None
        self.order, self.aircraft = order, aircraft

    def found_island(self) -> int:
        """Number of a new island without frames; numbers are never reused."""
        self.merged_into.append(None)
        return len(self.merged_into) - 1

    def put(self, frame: int, pose: Pose, island: int) -> None:
        """Place a frame, or move it."""
        self.put_all([frame], [pose], island)

    def put_all(
        self,
        frames: Sequence[int],
        poses: Sequence[Pose],
        island: int,
        lenses: Mapping[CameraNumber, Lens] = MappingProxyType({}),
    ) -> None:
        """Place or move frames, all on one island, and update its lenses.

        The only way a lens changes: every frame of that camera on the island moves with it.
        """
        changed = {number for number, lens in lenses.items() if self.camera_on(island, number) != lens.camera}
        self.lenses |= {(island, number): lens for number, lens in lenses.items()}
        for frame, pose in zip(frames, poses, strict=True):
            number = self.frames[frame].camera
            self.lenses.setdefault((island, number), Lens(self.camera_on(island, number)))
            self.note(frame, pose=pose)
            self.roots.setdefault(island, frame)
        self.islands[list(frames)] = island
        shifted = {f for f in self.members(island).tolist() if self.frames[f].camera in changed} if changed else set()
        for frame in shifted.union(frames):
            self.boxes[frame] = box_of(self.pose_of(frame), self.camera_of(frame))
            self.moved.add(frame)

    def merge(self, goes: int, stays: int) -> None:
        """Merge an island into another one, where all its frames must have been put."""
        self.merged_into[goes] = stays
        self.lenses = {key: lens for key, lens in self.lenses.items() if key[0] != goes}
        known = [self.unevenness.pop(island) for island in (goes, stays) if island in self.unevenness]
        if known:  # until both are adjusted together
            self.unevenness[stays] = max(known)
        islands = (self.islands[b.frame_a] == self.islands[b.frame_b] for b in self.bridges)
        self.bridges = [bridge for bridge, same in zip(self.bridges, islands, strict=True) if not same]

    def note(self, frame: int, **known: object) -> None:
        """Update a frame's state; the names are those of GraphFrame's fields."""
        self.frames[frame] = replace(self.frames[frame], **known)  # type: ignore[arg-type]

    def take_back(self, frame: int) -> None:
        """Make a frame unplaced and unlinked again."""
        for other in list(self.frames[frame].inliers):
            self.unlink(frame, other)
        self.note(frame, pose=None, drawn=None, relief=None)
        if self.roots.get(int(self.islands[frame])) == frame:
            del self.roots[int(self.islands[frame])]
        self.islands[frame] = NOWHERE
        self.boxes[frame] = np.nan
        self.moved.discard(frame)

    def link(self, a: int, b: int, registration: Registration) -> None:
        """Keep the registration of frame a with frame b, thinned to well-spread matches."""
        features = self._as_stored(registration.features, a, b)
        apart = held_out(features)
        matched, of_patches = np.split(registration.pixels_a, [len(features)])
        clear = clear_of(of_patches, matched[apart], 2 * self.sizes[self.frames[a].camera].half_diagonal)
        used = np.flatnonzero(np.concatenate([~apart, clear]))
        chosen = used[well_spread(registration.pixels_a[used], self._matches_per_link)]
        self.unlink(a, b)
        self.links[a, b] = Link(
            pixels_a=registration.pixels_a[chosen],
            pixels_b=registration.pixels_b[chosen],
            features=features[~apart],
            held_out=features[apart],
            doubtful=self._as_stored(held_out_doubtful(registration.tentative, features), a, b),
        )
        for frame, other in ((a, b), (b, a)):
            self.note(frame, inliers={**self.frames[frame].inliers, other: registration.independent_inliers})

    def _as_stored(self, features: AnyPairsNx2, a: int, b: int) -> FeaturePairsNx2:
        """Pairs of features of two frames, in the smallest type: there are a dozen links to a frame."""
        most = max(len(self.frames[frame].features) for frame in (a, b))
        return features.astype(np.uint16) if most <= np.iinfo(np.uint16).max else features.astype(np.uint32)

    def unlink(self, a: int, b: int) -> None:
        for first, second in ((a, b), (b, a)):
            self.links.pop((first, second), None)
            inliers = self.frames[first].inliers
            if second in inliers:
                self.note(first, inliers={other: count for other, count in inliers.items() if other != second})

    def fold(self) -> None:
        """Keep of all links only what adjustments and later comparisons use, and of features not their places: for a graph that
        others will join, who have the registrations and the features at hand."""
        for frame, state in enumerate(self.frames):
            matched = np.packbits(self.matched_before(frame)).tobytes()
            self.note(frame, matched_in_folded=matched, features=replace(state.features, kept_points=NO_POINTS))
        self.links = {key: link.folded() for key, link in self.links.items()}

    def unfold(self, points_of: Callable[[str, int], Shelved]) -> None:
        """After `fold`: where the places of each frame's features are, by its name and their number. Links stay folded."""
        for frame, state in enumerate(self.frames):
            points = points_of(state.name, len(state.features.descriptors))
            self.note(frame, features=replace(state.features, kept_points=points))

    @property
    def true_share(self) -> float:
        """Share of the cells of a true overlap that matches confirm, as observed in this flight."""
        return min(max(self.cells_confirmed / self.cells_expected, LEAST_SHARE), MOST_SHARE)

    def note_believed(self, cells: int, share: float) -> None:
        """Record an accepted frame: its cells and the share confirmed."""
        self.cells_expected += cells
        self.cells_confirmed += share * cells

    def matched_before(self, frame: int, but: int | None = None) -> Mask:
        """Which of a frame's features (n,) its links have matched; `but`: a frame whose links are ignored, unless folded."""
        count, folded = len(self.frames[frame].features), self.frames[frame].matched_in_folded
        matched = np.zeros(count, bool)
        if folded:
            matched |= np.unpackbits(np.frombuffer(folded, np.uint8), count=count).astype(bool)
        for other in self.frames[frame].inliers.keys() - {but}:
            first = (frame, other) in self.links
            link = self.links[(frame, other) if first else (other, frame)]
            for features in (link.features, link.held_out):
                matched[features[:, 0 if first else 1]] = True
        return matched

    def camera_on(self, island: int, number: CameraNumber) -> Camera:
        """A camera as an island knows it; without frames of it there, as known to the island with most of them."""
        if (island, number) in self.lenses:
            return self.lenses[island, number].camera
        best = self._with_most([other for other, camera in self.lenses if camera == number], number)
        return self.sizes[number] if best is None else self.lenses[best, number].camera

    def best_known_lens(self, number: CameraNumber) -> int | None:
        """The island that has estimated a camera's lens from most frames, if from enough; else None."""
        known = [
            island
            for (island, camera), lens in self.lenses.items()
            if camera == number and lens.information is not None
        ]
        best = self._with_most(known, number)
        return best if best is not None and self.count_with_camera(best, number) >= LENS_KNOWN else None

    def _with_most(self, islands: list[int], number: CameraNumber) -> int | None:
        """The island with most frames of a camera, the oldest if tied; None if there are none."""
        return max(islands, key=lambda island: (self.count_with_camera(island, number), -island), default=None)

    def camera_of(self, frame: int) -> Camera:
        """The camera of a placed frame."""
        return self.camera_on(self.island_of(frame), self.frames[frame].camera)

    def pose_of(self, frame: int) -> Pose:
        pose = self.frames[frame].pose
        assert pose is not None, "only placed frames have a pose"
        return pose

    def island_of(self, frame: int) -> int:
        assert self.islands[frame] != NOWHERE, "only placed frames lie on an island"
        return int(self.islands[frame])

    def placed(self) -> Indices:
        """Frames placed on any island, in order of arrival."""
        return np.flatnonzero(self.islands != NOWHERE)

    def members(self, island: int) -> Indices:
        """Frames of an island, in order of arrival."""
        return np.flatnonzero(self.islands == island)

    def count_members(self, island: int) -> int:
        return int(np.count_nonzero(self.islands == island))

    def elsewhere(self, island: int) -> Indices:
        """Placed frames of the other islands."""
        return np.flatnonzero((self.islands != NOWHERE) & (self.islands != island))

    def count_with_camera(self, island: int, number: CameraNumber, most: int | None = None) -> int:
        """Number of an island's frames taken by a camera, at most `most`."""
        count = int(np.count_nonzero((self.islands == island) & (self.cameras == number)))
        return count if most is None else min(count, most)

    def frame_counts(self) -> dict[int, int]:
        """Number of placed frames by island."""
        numbers, counts = np.unique(self.islands[self.placed()], return_counts=True)
        return dict(zip(numbers.tolist(), counts.tolist(), strict=True))


def box_of(pose: Pose, camera: Camera) -> Box4:
    """Bounding box (x0, y0, x1, y1) of a frame's footprint on the canvas; NaN where it sees no ground."""
    outline = footprint(pose, camera, per_side=3)
    outline = outline[np.isfinite(outline).all(axis=1)]
    if not len(outline):
        return np.full(4, np.nan)
    return np.concatenate([outline.min(axis=0), outline.max(axis=0)])


def centres(boxes: BoxesNx4) -> PointsNx2:
    """Centres (n, 2) of boxes (n, 4)."""
    return (boxes[:, :2] + boxes[:, 2:]) / 2
