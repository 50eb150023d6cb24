"""Gains of frames: one per frame and colour channel, that take out what the camera alone has changed.

A frame is compared with those taken just before and after it, over the ground that they share: how much brighter or darker it is
than all of them together. What reverts within a few frames (steps of automatic exposure, a white balance that flips) is the
camera, and goes as far as it is clearly more than what light does (`unnoticed`); what is less, or lasts longer (shade, haze,
another heading towards the sun, an exposure that follows the ground), stays as it was photographed, and `light_field` blends it
over the ground that frames share. Nothing adds up along a chain of frames, as
it does where gains make all overlaps agree (M. Brown and D. Lowe, "Automatic Panoramic Image Stitching using Invariant
Features", IJCV 74(1), 2007, section 6). Each channel has its own gain because automatic white balance changes them separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from gcs_mosaic.render.light_field import LightOverlap, light_overlap
from gcs_mosaic.render.vignetting import NO_SUMS, RadialSums, Vignetting, log_brightness, radial_sums, radii
from gcs_mosaic.render.warp import warped
from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR, Levels, Mask, Matrix, PointsNx2, Vector

Gain = tuple[float, ...]  # one per band

# Colours of a thumbnail, grey levels: false colours have 99 and more and 53 and more, the most colourful ground 57 and 36.
PALETTE_SATURATION = 75  # median of highest minus lowest channel
PALETTE_SPREAD = 40  # RMS distance from the mean of all that is not grey: ground has one hue, a palette several
# Where frames use but a part of the palette both may be less, but then all colours lie on one curve: of the variance of hues so
# many places along it leave 0.003 to 0.039 (eleven palettes over thermal frames, JPEGs), on colourful ground 0.066 to 0.15.
CURVE_SATURATION, CURVE_SPREAD, BESIDE_CURVE = 60, 14, 0.05
# What brightness alone leaves of that variance: of palettes 0.56 and more, next to nothing of ground of one hue in shade and sun.
BESIDE_BRIGHTNESS = 0.3
PLACES, CURVE_SAMPLE, CURVE_TURNS = 24, 2000, 12
# Of a grey picture all but so many pixels have their highest and lowest channel within so many levels: compression leaves a level
# or two, and a crosshair, a logo or a bar of colours in it takes less than a hundredth.
GREY_SHARE, GREY_LEVELS = 0.99, 3.0
DARKEST, BRIGHTEST = 8, 247  # grey levels; beyond them a channel may be clipped and is ignored
# Grey levels: what a factor above 1 brings beyond the first is rolled off so that this white stays what it is.
SHOULDER, WHITE = 200.0, 250.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureSettings:
    """How strongly gains follow the overlaps."""

    # Frames before and after a frame that it is compared with: what lasts longer than these is not the camera alone.
    around: int = 3
    # Log brightness: what differs by less is left to light fields, what differs by far more is the camera.
    unnoticed: float = 0.15
    unnoticed_cast: float = 0.05  # of a colour; shade and sun differ in brightness far more than in colour
    full_trust: int = 200  # thumbnail px of overlap that have half the weight of an infinite overlap
    least_gain: float = 0.25  # beyond these limits the image would only be noise
    most_gain: float = 4.0  # see least_gain

    def __post_init__(self) -> None:
        for name in ("around", "full_trust"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name}: expected 0 or more, got {getattr(self, name):g}")
        for name in ("unnoticed", "unnoticed_cast"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected more than 0, got {getattr(self, name):g}")
        if not 0 < self.least_gain <= 1 <= self.most_gain:
            raise ValueError(
                f"least_gain, most_gain: expected 0 < least <= 1 <= most, got {self.least_gain:g}, {self.most_gain:g}"
            )


@dataclass(frozen=True, slots=True)
class OverlapMeans:
    """Mean levels of each band over the overlap of two frames, its size in thumbnail pixels, its sums for
    vignetting, and what the frames' light fields follow from."""

    mean_i: Gain
    mean_j: Gain
    count: int
    radial: RadialSums = NO_SUMS
    light: LightOverlap | None = None

    def without_sums(self) -> OverlapMeans:
        """The same without what only the estimate of vignetting needs, once: a frame has ten overlaps."""
        return replace(self, radial=replace(self.radial, products=(), wanted=()))

    def flattened(self, of_i: Vignetting, of_j: Vignetting) -> OverlapMeans:
        """The means with both frames' vignetting removed."""
        (fall_i,), (fall_j,) = (
            log_brightness(curves, np.array([at]))
            for curves, at in ((of_i, self.radial.mean_i), (of_j, self.radial.mean_j))
        )
        flat_i, flat_j = (
            tuple((np.array(mean) * np.exp(-fall)).tolist())
            for mean, fall in ((self.mean_i, fall_i), (self.mean_j, fall_j))
        )
        return replace(self, mean_i=flat_i, mean_j=flat_j)


Observation = tuple[int, int, OverlapMeans]  # frame i, frame j, their overlap


def overlap_means(small_i: Levels, small_j: Levels, places: PointsNx2) -> OverlapMeans | None:
    """Means over the overlap of two thumbnails (h, w, bands) in grey levels; None if their bands differ or no unclipped pixels
    are shared.

    `places`: where the pixels of thumbnail i, as in `pixels_of`, are in thumbnail j; NaN for nowhere.
    """
    if small_i.shape[2] != small_j.shape[2]:
        return None
    height, width = small_i.shape[:2]
    grid = pixels_of(width, height).reshape(height, width, 2)
    there, seen_from_i, usable = seen_from(small_i, small_j, places)
    usable &= _unclipped(small_i) & _unclipped(seen_from_i)
    if not usable.any():
        return None
    log_ratio = np.log(small_i[usable] / seen_from_i[usable])
    at_i, at_j = (
        radii(grid[usable], width, height),
        radii(there[usable].astype(np.float64), small_j.shape[1], small_j.shape[0]),
    )
    sums = radial_sums(at_i, at_j, log_ratio)
    ratios = np.zeros(small_i.shape, np.float32)
    ratios[usable] = log_ratio
    light = light_overlap(ratios, there, usable, (small_j.shape[1], small_j.shape[0]))
    return OverlapMeans(_mean(small_i[usable]), _mean(seen_from_i[usable]), int(usable.sum()), sums, light)


@lru_cache(4)  # of one camera's thumbnails they are the same
def pixels_of(width: int, height: int) -> PointsNx2:
    """The pixels (h * w, 2) of a picture, row by row."""
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64).reshape(-1, 2)
    pixels.flags.writeable = False
    return pixels


def seen_from(small_i: Levels, small_j: Levels, places: PointsNx2) -> tuple[FloatImage, Levels, Mask]:
    """Of each pixel of thumbnail i (h, w, ...): where it is in thumbnail j, what j shows there, and whether it does; `places` as
    in `overlap_means`."""
    height, width = small_i.shape[:2]
    there = np.nan_to_num(places.reshape(height, width, 2), nan=-1e4).astype(np.float32)
    limits = np.array([small_j.shape[1], small_j.shape[0]]) - 1
    inside = np.asarray(((there >= 0) & (there <= limits)).all(axis=-1))
    return there, warped(small_j, there, cv2.INTER_LINEAR), inside


def log_gains(
    count: int, seen: Sequence[Observation], settings: ExposureSettings | None = None, bands: int = 3
) -> Matrix:
    """Log gains (count, bands) of frames, from the overlaps of those taken in close succession; 0 for frames without any."""
    settings = settings or ExposureSettings()
    apart, total = (
        np.zeros((count, bands)),
        np.ones((count, 1)),
    )  # each frame's own weight is that of an infinite overlap
    for i, j, means in seen:
        share, ratio = means.count / (means.count + settings.full_trust), _log_ratio(means)
        for frame, brighter in ((i, ratio), (j, -ratio)):
            apart[frame] += share * brighter
            total[frame] += share
    return _of_camera(apart / total, settings)


def gain_beside(seen: Sequence[OverlapMeans], settings: ExposureSettings | None = None, bands: int = 3) -> Gain:
    """The gain of a new frame i beside the frames j taken just before it; 1 without overlaps."""
    found = log_gains(1 + len(seen), [(0, 1 + k, means) for k, means in enumerate(seen)], settings, bands)
    return bounded(found[0], settings or ExposureSettings())


def is_false_colour(small: Levels) -> bool:
    """Whether a thumbnail (h, w, bands) in grey levels shows a thermal camera's palette.

    Its colours encode temperatures on each frame's own scale: a gain would turn them into other colours of the palette, or
    colours outside it.
    """
    if small.shape[2] != 3:
        return False
    colours = small.reshape(-1, 3).astype(np.float64)
    saturation, spread = float(np.median(np.ptp(colours, axis=1))), _spread_of_hues(colours)
    if saturation > PALETTE_SATURATION and spread > PALETTE_SPREAD:
        return True
    if saturation <= CURVE_SATURATION or spread <= CURVE_SPREAD:
        return False
    return _beside_curve(colours) < BESIDE_CURVE and _beside_brightness(colours) > BESIDE_BRIGHTNESS


def _spread_of_hues(colours: Matrix | FloatImage) -> float:
    """RMS distance of what is not grey in colours (n, 3) from its mean."""
    hue = colours - colours.mean(axis=1, keepdims=True)
    return float(np.sqrt(hue.var(axis=0).sum()))


def _beside_curve(colours: Matrix) -> float:
    """Share of the variance of the hues of colours (n, 3) that lies beside a curve through them: k-means from even parts along
    the longest axis, so the same for the same colours. All of it for fewer than it has places."""
    some = colours[:: max(1, len(colours) // CURVE_SAMPLE)].astype(np.float32)
    if len(some) < PLACES:
        return 1.0
    _, _, axes = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)
    places = np.empty((len(some), 1), np.int32)
    places[np.argsort(some @ axes[0], kind="stable"), 0] = np.arange(len(some)) * PLACES // len(some)
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, CURVE_TURNS, 0.5)
    _, found, middles = cv2.kmeans(some, PLACES, places, until, 1, cv2.KMEANS_USE_INITIAL_LABELS)
    return float(
        (_spread_of_hues(np.asarray(some - middles[found[:, 0]], np.float32)) / max(_spread_of_hues(some), 1e-9)) ** 2
    )


def _beside_brightness(colours: Matrix) -> float:
    """Share of the variance of the hues of colours (n, 3) that their brightness does not explain in proportion."""
    grey = colours.mean(axis=1, keepdims=True)
    of_one_hue = grey * ((colours - grey) * grey).sum(axis=0) / max(float((grey * grey).sum()), 1e-9)
    return (_spread_of_hues(colours - of_one_hue) / max(_spread_of_hues(colours), 1e-9)) ** 2


def is_grey(some: Levels) -> bool:
    """Whether a sample of a picture (h, w, bands) in grey levels is of one band, or of three that show the same, as those of a
    thermal camera's JPEGs do."""
    if some.shape[2] != 3:
        return bool(some.shape[2] == 1)
    apart = some.max(axis=2).astype(np.float32) - some.min(axis=2)
    return bool(np.quantile(apart, GREY_SHARE) <= GREY_LEVELS)


def apply_gain(image: ImageBGR, gain: Gain) -> ImageBGR:
    """The image (h, w, 3) with its channels multiplied and rolled off; the same array for gains of 1."""
    if gain == (1.0, 1.0, 1.0):
        return image
    levels = rolled_off((np.arange(256)[:, None] * np.array(gain)).astype(np.float32), np.array(gain, np.float32))
    table = np.clip(np.rint(levels), 0, 255).astype(np.uint8).reshape(1, 256, 3)
    return np.asarray(cv2.LUT(image, table), dtype=np.uint8)


def rolled_off(levels: FloatImage, factors: FloatImage) -> FloatImage:
    """Levels that factors (of a shape that broadcasts) have made, compressed between SHOULDER and what WHITE has become, if that
    is more than WHITE: light that the photograph has is not blown. Monotonous, and smooth at the shoulder."""
    reach = np.maximum(np.float32(WHITE) * factors - np.float32(SHOULDER), np.float32(WHITE - SHOULDER))
    bend = np.float32(1 / (WHITE - SHOULDER)) - np.float32(1) / reach  # 0 for factors of 1 and less
    beyond = np.maximum(levels, np.float32(SHOULDER))
    beyond -= np.float32(SHOULDER)
    divisor = beyond * bend
    divisor += 1
    rolled = levels - beyond
    np.divide(beyond, divisor, out=divisor)
    rolled += divisor
    return rolled


def _unclipped(image: Levels) -> Mask:
    return np.asarray(((image >= DARKEST) & (image <= BRIGHTEST)).all(axis=-1))


def _mean(pixels: Levels) -> Gain:
    return tuple(pixels.mean(axis=0).tolist())


def _of_camera(apart: Matrix, settings: ExposureSettings) -> Matrix:
    """Of what frames lack of the log brightness (n, bands) around them, as much as the camera explains. Brightness and cast each
    go as a whole: what is left of a cast has the same hue."""
    grey = apart.mean(axis=1, keepdims=True)
    cast = apart - grey
    of_grey, of_cast = (np.abs(one).max(axis=1, keepdims=True) for one in (grey, cast))
    return _beyond(grey, of_grey, settings.unnoticed) + _beyond(cast, of_cast, settings.unnoticed_cast)


def _beyond(apart: Matrix, size: Matrix, unnoticed: float) -> Matrix:
    """Next to nothing of what is small, next to all of what is large."""
    return np.asarray(apart * size**4 / (size**4 + unnoticed**4))


def _log_ratio(means: OverlapMeans) -> Vector:
    """log gain_i - log gain_j for which the two means agree."""
    return np.asarray(np.log(np.array(means.mean_j) / np.array(means.mean_i)), dtype=np.float64)


def bounded(log_gain: Vector, settings: ExposureSettings) -> Gain:
    """A gain within its limits."""
    return tuple(np.clip(np.exp(log_gain), settings.least_gain, settings.most_gain).tolist())
