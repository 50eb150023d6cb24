"""Two frames with their matches, in pixels of the feature pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Mask, Matrix3x3, PointsNx2, Vector2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.fixed_pattern import moving
from gcs_mosaic.stitch.features.matching import match
from gcs_mosaic.stitch.registration.a_contrario import SAMPLE, cell_numbers
from gcs_mosaic.stitch.registration.homography import robust_homography
from gcs_mosaic.stitch.registration.outcome import Registration


@dataclass(frozen=True, slots=True)
class FramePair:
    """Two frames in pixels of their feature pictures: all their features (n, 2), (m, 2), and the matches (k, 2)."""

    all_a: PointsNx2
    all_b: PointsNx2
    size_a: Vector2
    size_b: Vector2
    scale_a: float  # full-resolution pixels per pixel of the feature picture
    scale_b: float
    matches: IndexPairsNx2
    features: IndexPairsNx2  # (k, 2) the matches as indices into all features of either frame
    again_a: Mask  # (n,) features matched before, see `register`
    again_b: Mask  # (m,)

    @property
    def a(self) -> PointsNx2:
        return self.all_a[self.matches[:, 0]]

    @property
    def b(self) -> PointsNx2:
        return self.all_b[self.matches[:, 1]]

    def reduced(self, b_from_a: Matrix3x3) -> Matrix3x3:
        """A homography between full-resolution pixels as one between pixels of the feature pictures."""
        return np.diag([1 / self.scale_b, 1 / self.scale_b, 1]) @ b_from_a @ np.diag([self.scale_a, self.scale_a, 1])

    def enlarged(self, b_from_a: Matrix3x3) -> Matrix3x3:
        """The inverse of `reduced`."""
        return np.diag([self.scale_b, self.scale_b, 1]) @ b_from_a @ np.diag([1 / self.scale_a, 1 / self.scale_a, 1])


@dataclass(frozen=True, slots=True)
class MatchPart:
    """Which of a frame's n features take part; each (n,), None means all or none.

    `seen`: those the other frame should see, as far as poses are known. `again`: those matched before, with other frames. In
    woods few features are ever matched again, over fields nearly all: features matched before must match again where the frames
    overlap; features never matched carry no evidence.
    """

    seen: Mask | None = None
    again: Mask | None = None

    def chosen(self, features: Features) -> Indices:
        return np.arange(len(features)) if self.seen is None else np.flatnonzero(self.seen)


ALL = MatchPart()


def matched(a: Features, b: Features, part_a: MatchPart, part_b: MatchPart, ratio: float) -> FramePair:
    chosen_a, chosen_b = part_a.chosen(a), part_b.chosen(b)
    matches = match(a.descriptors[chosen_a], b.descriptors[chosen_b], ratio)
    matches = matches[moving(a, b, np.stack([chosen_a[matches[:, 0]], chosen_b[matches[:, 1]]], axis=1))]
    return frame_pair(a, b, part_a, part_b, matches)


def frame_pair(a: Features, b: Features, part_a: MatchPart, part_b: MatchPart, matches: IndexPairsNx2) -> FramePair:
    """Two frames with these matches (k, 2) of the features that take part."""
    chosen_a, chosen_b = part_a.chosen(a), part_b.chosen(b)
    return FramePair(
        all_a=a.points[chosen_a].astype(np.float64) / a.scale,
        all_b=b.points[chosen_b].astype(np.float64) / b.scale,
        size_a=np.array([a.width, a.height]) / a.scale,
        size_b=np.array([b.width, b.height]) / b.scale,
        scale_a=a.scale,
        scale_b=b.scale,
        matches=matches,
        features=np.stack([chosen_a[matches[:, 0]], chosen_b[matches[:, 1]]], axis=1),
        again_a=np.zeros(len(chosen_a), bool) if part_a.again is None else part_a.again[chosen_a],
        again_b=np.zeros(len(chosen_b), bool) if part_b.again is None else part_b.again[chosen_b],
    )


def robust_homography_among(pair: FramePair, left: Mask, threshold: float) -> tuple[Matrix3x3 | None, Mask]:
    """b_from_a (3x3) of the remaining matches, and its inliers among all matches (k,); or None."""
    inlier = np.zeros(len(left), bool)
    if left.sum() <= SAMPLE:
        return None, inlier
    homography, inlier[left] = robust_homography(pair.a[left], pair.b[left], threshold)
    return homography, inlier


def independent_count(a: PointsNx2, b: PointsNx2, cell: float) -> int:
    """Number of inliers in distinct cells, the smaller of the two frames: features pile up on one spot."""
    return min(len(np.unique(cell_numbers(points, cell))) for points in (a, b))


def in_full_resolution(
    pair: FramePair,
    homography: Matrix3x3,
    inlier: Mask,
    displaced: Mask,
    independent: int,
    evidence: float,
) -> Registration:
    return Registration(
        pixels_a=pair.a[inlier] * pair.scale_a,
        pixels_b=pair.b[inlier] * pair.scale_b,
        features=pair.features[inlier],
        b_from_a=pair.enlarged(homography),
        independent_inliers=independent,
        evidence=evidence,
        displaced_a=pair.a[displaced] * pair.scale_a,
        displaced_b=pair.b[displaced] * pair.scale_b,
        tentative=pair.features,
    )
