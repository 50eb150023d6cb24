"""Fixed pattern: what stands still in the image while the ground moves.

An overlay (`still`) covers the ground: features and texture are without it. A sensor's pattern or dirt on the lens is added to
the ground: a faint image may show more of it than of the ground, and it matches itself at zero motion. Its mean over many
frames is subtracted before feature detection and from the texture, and for nothing else. A frame is counted only if it differs
from the last one counted: over a hovering aircraft the mean would be the ground. A flight has a running mean; an archive, of
which all frames are known, makes its own of the same parts (`archive.fixed_patterns`).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyPointsNx2, Band, FaintImage, FloatImage, IndexPairsNx2, Mask, Texture
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, faint_features, joined, without_overlay
from gcs_mosaic.stitch.features.faint import PER_DEVIATION, blurred_faint
from gcs_mosaic.stitch.features.still import Grounds
from gcs_mosaic.stitch.features.texture import coarse
from gcs_mosaic.stitch.transaction import Kept, Numbers, Snapshot

Kind = tuple[int, int, int | None]  # width and height of a frame, and what carried the camera: each is one camera

LEAST_FRAMES = 6  # different frames before the mean is used: a sixth of each one's ground is left in it
MEMORY = 64  # frames; sensors drift and recalibrate during a flight
# Deviations at which a pixel is clipped: a bright roof in one frame must not leave a ghost in all later ones.
MOST_OF_A_PIXEL = 2.0
# Two frames show the same ground at the same place, like those of a hovering aircraft, if all but a fifth of their blocks
# correlate at least so: an overlay or dirt makes any of the others agree, and they may have most of the energy. Of faint
# pictures, which share the sensor's pattern: 0.87 and more when hovering, down to ground a third as strong as the noise; 0.5 and
# less over other ground with a pattern twice as strong as the ground.
QUANTILE = 0.2
SAME_GROUND = 0.8
# Of textures: 0.05 and less over other ground with a display and bars, 0.9 when hovering, less where woods sway.
SAME_TEXTURE = 0.2
ACROSS, DOWN = 16, 12  # blocks
LEAST_ENERGY = 0.02  # of the median block's; less is no texture
FEW = 5  # matches; fewer support no homography
STILL_PX = 4.0  # px of the feature picture; least motion of a match that is ground and not the pattern
MOST_PATTERN = 0.25  # of an image's energy; the mean of six different grounds alone has a sixth
_PICTURES = ("_patterns", "_last", "_means", "_squares", "_last_textures")


class StillPattern(Kept):
    """The mean of many faint pictures and of many textures, and what stands still in those, for each camera."""

    def __init__(self) -> None:
        self._patterns: dict[Kind, FloatImage] = {}
        self._counts: dict[Kind, int] = {}
        self._last: dict[Kind, FloatImage] = {}  # blurred faint picture of the frame counted last
        self._means: dict[Kind, FloatImage] = {}  # of textures, see `Grounds`
        self._squares: dict[Kind, FloatImage] = {}
        self._grounds: dict[Kind, int] = {}
        self._last_textures: dict[Kind, Texture] = {}
        self._still: dict[Kind, StillMask | None] = {}

    def saved(self) -> Snapshot:
        """Pictures that are others after the next frame: a file of values to which they were appended would grow with each."""
        numbers = {name: {kind: Numbers.of(one) for kind, one in getattr(self, name).items()} for name in _PICTURES}
        return super().saved() | numbers

    def load(self, saved: Snapshot) -> None:
        pictures = {name: {kind: one.array() for kind, one in saved[name].items()} for name in _PICTURES}
        super().load(saved | pictures)

    def without(self, features: Features, settings: FeatureSettings, aircraft: int | None = None) -> Features:
        """A frame's features, detected again without the fixed pattern once that is known, and without what an overlay covers;
        learns from the frame. Once per frame."""
        kind = features.width, features.height, aircraft
        faint, texture = features.faint, features.texture
        counted = None if faint is None else self._learn(kind, faint)
        if texture is not None:
            self._learn_texture(kind, texture, counted)
        known = faint is not None and self._counts[kind] >= LEAST_FRAMES  # else `moving` separates its matches
        pattern = self._patterns[kind] if known else None
        return freed(features, pattern, settings, self._means.get(kind), self._still.get(kind))

    def _learn(self, kind: Kind, faint: FaintImage) -> bool:
        """Whether the frame was counted."""
        blurred = blurred_faint(faint)
        last = self._last.get(kind)
        if last is not None and same_ground(blurred, last):
            return False
        levels = clipped(faint)
        count = self._counts.get(kind, 0)
        pattern = self._patterns.get(kind, levels)
        self._patterns = self._patterns | {kind: pattern + (levels - pattern) * np.float32(1 / min(count + 1, MEMORY))}
        self._counts = self._counts | {kind: count + 1}
        self._last = self._last | {kind: blurred}
        return True

    def _learn_texture(self, kind: Kind, texture: Texture, counted: bool | None) -> None:
        """`counted`: whether the frame's faint picture was; None if it has none."""
        before, last = self._known(kind), self._last_textures.get(kind)
        if before is not None and before.mean.shape != texture.shape:
            return  # another camera's
        if counted is None:
            counted = last is None or not same_texture(texture, last)
        if not counted:
            return
        grounds = Grounds.of(texture) if before is None else before.after(texture)
        self._means = self._means | {kind: grounds.mean}
        self._squares = self._squares | {kind: grounds.square}
        self._grounds = self._grounds | {kind: grounds.count}
        self._last_textures = self._last_textures | {kind: texture}
        self._still = self._still | {kind: grounds.still()}

    def _known(self, kind: Kind) -> Grounds | None:
        count = self._grounds.get(kind)
        return None if count is None else Grounds(count, self._means[kind], self._squares[kind])


def same_texture(a: Texture, b: Texture) -> bool:
    """Whether two textures show the same ground at the same place; of two that show none, they do."""
    return _least_correlation(coarse(a), coarse(b)) > SAME_TEXTURE


def _least_correlation(one: FloatImage, other: FloatImage) -> float:
    """Correlation that all but `QUANTILE` of the blocks of two pictures reach; 1 if neither shows anything."""
    both, of_one, of_other = (_block_means(values) for values in (one * other, one * one, other * other))
    least = np.minimum(of_one, of_other)
    seen = least > LEAST_ENERGY * float(np.median(least))
    if not seen.any():
        return 1.0
    return float(np.quantile(both[seen] / np.sqrt(of_one[seen] * of_other[seen]), QUANTILE))


def _block_means(values: FloatImage) -> FloatImage:
    return np.asarray(cv2.resize(values, (ACROSS, DOWN), interpolation=cv2.INTER_AREA), dtype=np.float32)


def same_ground(a: FloatImage, b: FloatImage) -> bool:
    """Whether two blurred faint pictures show the same ground at the same place."""
    return _least_correlation(a, b) > SAME_GROUND


def clipped(faint: FaintImage) -> FloatImage:
    """A faint picture as it is averaged; its values are whole numbers."""
    bound = MOST_OF_A_PIXEL * PER_DEVIATION
    return np.clip(faint.astype(np.float32), -bound, bound)


def freed(
    features: Features,
    pattern: FloatImage | None,
    settings: FeatureSettings,
    mean: FloatImage | None = None,
    still: StillMask | None = None,
) -> Features:
    """A frame's features and texture without what is known to stand still: the mean of faint pictures and that of textures, which
    are subtracted if the frame is faint, and what an overlay covers."""
    if pattern is not None and features.faint is not None:
        features = _found_again(features, features.faint, pattern, still, settings)
        texture = features.texture
        if texture is not None and mean is not None and texture.shape == mean.shape:
            levels = np.clip(np.rint(picture_without(texture, mean, still)), -127, 127).astype(np.int8)
            features = replace(features, kept_texture=levels)
    return features if still is None else without_overlay(features, still)


def _found_again(
    features: Features, faint: FaintImage, pattern: FloatImage, still: StillMask | None, settings: FeatureSettings
) -> Features:
    levels = picture_without(faint, pattern, still)
    found = faint_features(levels, features, settings)
    if _energy(levels) < (1 - MOST_PATTERN) * _energy(_uncovered(faint.astype(np.float32), still)):
        return found  # features of the unfiltered image may belong to the pattern
    return joined(_ordinary(features), found)


def moving(a: Features, b: Features, matches: IndexPairsNx2) -> Mask:
    """Which matches (k, 2) may be ground: none on an overlay that became known later; of the others all, unless the frames show
    different ground at the same place. Then matches that have not moved are the fixed pattern or an overlay."""
    of_a, of_b = a.points[matches[:, 0]], b.points[matches[:, 1]]
    open_ground = ~(_covered(a, of_a) | _covered(b, of_b))
    moved = np.linalg.norm(of_a / a.scale - of_b / b.scale, axis=1) > STILL_PX
    if np.count_nonzero(open_ground & ~moved) < FEW or shows_same_ground(a, b):
        return open_ground
    return np.asarray(open_ground & moved)


def _covered(frame: Features, points: AnyPointsNx2) -> Mask:
    """Which points (n, 2) of a frame an overlay covers."""
    return np.zeros(len(points), bool) if frame.still is None else frame.still.covers(points, frame.width, frame.height)


def shows_same_ground(a: Features, b: Features) -> bool:
    """Whether two frames show the same ground at the same place, or whether that cannot be told."""
    faint_a, faint_b = a.faint, b.faint
    if faint_a is not None and faint_b is not None and faint_a.shape == faint_b.shape:
        return same_ground(blurred_faint(faint_a), blurred_faint(faint_b))
    texture_a, texture_b = a.texture, b.texture
    if texture_a is None or texture_b is None or texture_a.shape != texture_b.shape:
        return True
    return same_texture(texture_a, texture_b)


def picture_without(picture: FaintImage | Texture, pattern: FloatImage, still: StillMask | None = None) -> FloatImage:
    """A faint picture or texture minus its projection onto the pattern, whose strength automatic gain changes between frames;
    0 where an overlay covers the ground, which takes no part in the projection."""
    levels, known = (_uncovered(one.astype(np.float32), still) for one in (picture, pattern))
    # What exceeds the pattern's range, an overlay not known yet, says nothing of its strength.
    within = np.clip(levels, known.min(), known.max())
    share = float((within * known).sum() / max(float((known * known).sum()), 1e-9))
    return np.asarray(levels - np.float32(max(share, 0.0)) * known, dtype=np.float32)


def _uncovered(levels: FloatImage, still: StillMask | None) -> FloatImage:
    if still is None:
        return levels
    height, width = levels.shape
    return np.where(still.pixels(height, width), np.float32(0), levels)


def _ordinary(features: Features) -> Features:
    """The features found in the image as it is."""
    first = slice(features.ordinary)
    points, descriptors = features.points[first], features.descriptors[first]
    return replace(features, kept_points=points, kept_descriptors=descriptors, kept_faint=None, ordinary=0)


def _energy(levels: Band) -> float:
    return float(np.square(levels.astype(np.float32)).sum())
