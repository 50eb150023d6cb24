"""What comes of a registration: where two frames show the same ground, or why that is not known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Matrix3x3, PointsNx2

NO_MATCHES = np.empty((0, 2), np.intp)
NO_PIXELS: PointsNx2 = np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class Registration:
    """Two overlapping frames: pixels of each that show the same ground, (m + p, 2) in full resolution, and b_from_a (3x3).

    The first m are inliers, with their `features`; the others are patches of the pictures.
    """

    pixels_a: PointsNx2
    pixels_b: PointsNx2
    features: IndexPairsNx2  # (m, 2) feature indices of the inliers in a and b
    b_from_a: Matrix3x3
    independent_inliers: int
    evidence: float  # -log10 of the expected number of equally good chance agreements
    displaced_a: PointsNx2 = field(default_factory=lambda: NO_PIXELS)  # matches off the plane, explained by parallax
    displaced_b: PointsNx2 = field(default_factory=lambda: NO_PIXELS)
    tentative: IndexPairsNx2 = field(default_factory=lambda: NO_MATCHES)  # (k, 2) feature indices, inliers or not
    beyond: float = 0.0  # evidence of the pixels that are not around matches; 0 where they were not asked

    def turned(self) -> Registration:
        """The same registration with the frames exchanged."""
        a_from_b = np.asarray(np.linalg.inv(self.b_from_a), dtype=np.float64)
        turned = replace(self, features=self.features[:, ::-1], tentative=self.tentative[:, ::-1])
        turned = replace(turned, displaced_a=self.displaced_b, displaced_b=self.displaced_a)
        return replace(turned, pixels_a=self.pixels_b, pixels_b=self.pixels_a, b_from_a=a_from_b)

    @property
    def proved(self) -> Registration:
        """The same with what proves it alone: patches only where the pixels do, since those of a look-alike agree, too."""
        if self.beyond or not len(self.features):
            return self
        count = len(self.features)
        return replace(self, pixels_a=self.pixels_a[:count], pixels_b=self.pixels_b[:count])

    @property
    def agreeing_a(self) -> PointsNx2:
        """Pixels (n, 2) of frame a that prove to be seen by b, on the plane or off it."""
        return np.concatenate([self.proved.pixels_a, self.displaced_a])


@dataclass(frozen=True, slots=True)
class NotRegistered:
    """Two frames not shown to overlap, and why; the pixels (m, 2) each that agreed nevertheless. `contradicted`: the overlap with
    most agreement, if nothing but what the frames show besides speaks against it."""

    reason: str
    inliers: int
    pixels_a: PointsNx2
    pixels_b: PointsNx2
    contradicted: Registration | None = None


def well_spread(points: PointsNx2, count: int) -> Indices:
    """Indices of at most `count` of the points (n, 2), by farthest-point sampling."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    distance = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    for _ in range(count - 1):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return np.array(chosen)
