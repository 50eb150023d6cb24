"""Overlays: what covers the ground at the same place of every frame (a burnt-in display, a logo, bars, dirt, a leg).

A texture's mean over n frames of different ground falls as 1 / sqrt(n) on ground and stays on what stands still. So each block
of pixels is judged by the energy of its mean relative to its variance. That of a sensor pattern all over the frame is nowhere
far above that of the frame's other blocks; an overlay is. Next to an overlay the local normalisation leaves little of the
ground: that is masked with it. What has no texture in any frame (the inside of a bar or of a logo) is masked if what surrounds
it stands still.

A flight along a straight shore, road or row of a field holds that still too, as long as heading and offset stay the same to some
pixels over some frames: the mask is made anew with each frame and loses it when the aircraft turns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, Mask, Texture
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.texture import PER_DEVIATION

BLOCK = 4  # px of a texture; below the width of a letter
LEAST_GROUNDS = (
    3  # frames of different ground before anything counts as still: a block's variance is that of many pixels
)
MEMORY = 64  # frames; an overlay may be switched off or moved, sensors drift and recalibrate
# Least energy of the mean relative to the variance. Over different ground 1.1 and less after 8 frames (the 99.9th percentile of a
# frame's blocks), 0.6 after 16; dirt 2 and more, a display over rich ground 3 and more, over poor ground hundreds.
LEAST_ODDS = 1.0
# The same for few frames, whose mean still has some of each one's ground: this leaves 0.0 to 0.3 % of the blocks of frames
# without overlay after 3, over a river along the flight 1.6 %.
LEAST_ODDS_TIMES_FRAMES = 32.0
# Relative to the median of the frame's blocks, which is 0.35 with a sensor pattern and 0.02 without: its rim has 38 times as much
# at most, text on it 350. Around such a place all of that counts that has as much as a rim.
OVER_PATTERN, BESIDE = 40.0, 6.0
QUIET = 0.01  # of the median energy: a tenth of the usual deviation; less is no texture
CLOSED = 7  # blocks, diameter: gaps between still places that are masked too: digits that change
REACH = 1  # blocks around what stands still that a descriptor's support (12 px of the feature picture) still touches


@dataclass(frozen=True, slots=True, eq=False)
class Grounds:
    """Textures of frames of different ground: how many, their mean (h, w), and the mean of their squares by blocks."""

    count: int
    mean: FloatImage
    square: FloatImage

    @staticmethod
    def of(texture: Texture) -> Grounds:
        levels = texture.astype(np.float32)
        return Grounds(1, levels, by_blocks(levels * levels))

    def after(self, texture: Texture) -> Grounds:
        """With one more, which counts no less than one in `MEMORY`."""
        new, share = Grounds.of(texture), np.float32(1 / min(self.count + 1, MEMORY))
        mean, square = self.mean + (new.mean - self.mean) * share, self.square + (new.square - self.square) * share
        return replace(self, count=self.count + 1, mean=mean, square=square)

    def still(self) -> StillMask | None:
        """What stands still in them; None if nothing does, or if that is not known yet."""
        if self.count < LEAST_GROUNDS:
            return None
        covered = _covered(self)
        return StillMask.of(covered) if covered.any() else None


def by_blocks(values: FloatImage) -> FloatImage:
    """Means of a picture (h, w) over blocks of about `BLOCK` px."""
    size = max(1, values.shape[1] // BLOCK), max(1, values.shape[0] // BLOCK)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)


def masked(texture: Texture, still: StillMask) -> Texture:
    """A texture (h, w) that is 0 where an overlay covers the ground."""
    height, width = texture.shape
    return np.where(still.pixels(height, width), np.int8(0), texture)


def _covered(seen: Grounds) -> Mask:
    """Blocks (rows, columns) that an overlay covers, with those that its descriptors reach."""
    frames = min(seen.count, MEMORY)
    energy, of_mean = (cv2.blur(one, (3, 3)) for one in (seen.square, by_blocks(seen.mean * seen.mean)))
    variance = np.maximum(energy - of_mean, (0.1 / PER_DEVIATION) ** 2) * np.float32(frames / (frames - 1))
    odds = np.maximum(of_mean - variance / frames, 0) / variance  # less what the mean has of each frame's ground
    quiet = energy < QUIET * np.median(energy)
    if quiet.all():
        return np.zeros_like(quiet)
    least, usual = max(LEAST_ODDS, LEAST_ODDS_TIMES_FRAMES / frames), float(np.median(odds[~quiet]))
    still = _touching(~quiet & (odds > max(least, BESIDE * usual)), odds > max(least, OVER_PATTERN * usual))
    return _widened(still | _surrounded(quiet, still))


def _touching(weak: Mask, strong: Mask) -> Mask:
    """Connected places of the weak ones with a strong one among them."""
    _, labels = cv2.connectedComponents(weak.astype(np.uint8))
    return np.asarray(weak & np.isin(labels, np.unique(labels[weak & strong])))


def _surrounded(quiet: Mask, still: Mask) -> Mask:
    """Connected quiet blocks of which most neighbours within the frame stand still."""
    found = np.zeros_like(quiet)
    if not still.any():
        return found
    count, labels = cv2.connectedComponents(quiet.astype(np.uint8))
    for label in range(1, count):
        inside = labels == label
        around = (cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~inside
        found |= inside & bool(around.any() and still[around].mean() > 0.5)
    return found


def _widened(still: Mask) -> Mask:
    """With the gaps closed, and all that a descriptor's support reaches."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (CLOSED, CLOSED))
    beyond = np.pad(still.astype(np.uint8), CLOSED)  # so that closing does not grow into the border
    closed = cv2.morphologyEx(beyond, cv2.MORPH_CLOSE, disc)[CLOSED:-CLOSED, CLOSED:-CLOSED]
    return np.asarray(cv2.dilate(closed, np.ones((2 * REACH + 1,) * 2, np.uint8)) > 0)
