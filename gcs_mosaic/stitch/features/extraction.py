"""Features of a frame at a bounded size, with byte descriptors for which smaller distance means more similar.

SIFT as RootSIFT: the square root of the L1-normalised descriptor, so that a dot product compares histograms by the Hellinger
kernel (Arandjelović and Zisserman, CVPR 2012). ORB's bits as +1 and -1: a quarter of their squared distance is the Hamming
distance. SURF unchanged. All descriptors of a kind have the same length, so the nearest is also the one with the largest dot
product.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import (
    Band,
    Bands,
    Descriptors,
    FaintImage,
    FloatImage,
    FloatRows,
    ImageGrey,
    Mask,
    Points32Nx2,
    Texture,
)
from gcs_mosaic.stitch.camera.bands import resized, stretched
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.detectors import FeatureKind, Found, detect, rounded
from gcs_mosaic.stitch.features.faint import HALF, detect_faint, equalised, faint_picture, is_noise
from gcs_mosaic.stitch.features.learned import FINE_BLUR, LearnedDetector, UnusableModel, read_detector
from gcs_mosaic.stitch.features.looks import looks
from gcs_mosaic.stitch.features.sharpness import sharpness
from gcs_mosaic.stitch.features.shelf import Shelve, Shelved, at_hand, exactly
from gcs_mosaic.stitch.features.still import masked
from gcs_mosaic.stitch.features.structure import shows_nothing
from gcs_mosaic.stitch.features.texture import texture

logger = logging.getLogger(__name__)

REACH = 12.0  # px of the feature picture: support radius of a SIFT descriptor of the usual size, two px


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSettings:
    """Feature extraction."""

    kind: FeatureKind = "sift"  # sift, orb or surf (needs mahotas); the others find less on bare ground
    megapixels: float = 0.75  # size of the feature picture; 1.8 gave the same map at 2-3 times the time
    count: int = 2000  # features kept per frame, the strongest
    contrast: float = 0.01  # SIFT's contrast threshold; low, for bare fields: `count` bounds the number anyway
    # number of features below which an image counts as faint and is searched again with its contrast equalised
    faint_below: int = 300
    band: int = 0  # for frames that are not in colour, counted from 1; 0: the mean of all, each at its own contrast
    # ONNX file of learned features, see `learned`, for where the others propose nothing that holds
    model: str | None = None


@dataclass(frozen=True, slots=True)
class Features:
    """Features of a frame, strongest first.

    `points` (n, 2) float32 in full-resolution pixels; `descriptors` (n, d), SIFT: 128 uint8, RootSIFT times 255, ORB: 256 int8,
    1 or -1, SURF: 64 int8, length 127; `scale`: full-resolution pixels per pixel of the feature picture. `faint`: the faint
    picture in which all but the first `ordinary` features were found, unless the fixed pattern was removed; `is_faint`: whether
    there was one. `texture`: what the
    frame looks like as a whole; None if that is not known. `dead`: the excluded border, in full-resolution pixels. `still`: what
    an overlay covers, where the texture is 0 and features are not matched; None where nothing is known to. The large ones may lie
    on a shelf.
    """

    kept_points: Points32Nx2 | Shelved
    kept_descriptors: Descriptors | Shelved
    width: int
    height: int
    scale: float
    kept_faint: FaintImage | Shelved | None = None
    ordinary: int = 0
    is_faint: bool = False
    dead: DeadBorder = NO_BORDER
    sharpness: float = 0.0  # see `sharpness`; 0 if not measured
    kept_texture: Texture | Shelved | None = None
    still: StillMask | None = None
    learned: Features | None = None  # of a model, if one is given: where these propose nothing
    shows_nothing: bool = False  # see `structure`; then there are none
    area: PictureArea | None = None  # where the frame holds a picture, and features are; None: everywhere
    looks: FloatRows | None = None  # of its cells, see `looks`

    def __len__(self) -> int:
        return self.kept_points.shape[0]

    @property
    def points(self) -> Points32Nx2:
        return at_hand(self.kept_points)

    @property
    def descriptors(self) -> Descriptors:
        return at_hand(self.kept_descriptors)

    @property
    def faint(self) -> FaintImage | None:
        return None if self.kept_faint is None else at_hand(self.kept_faint)

    @property
    def texture(self) -> Texture | None:
        if self.kept_texture is None:
            return None
        whole = at_hand(self.kept_texture)
        return whole if self.still is None else masked(whole, self.still)

    def shelved(self, shelve: Shelve) -> Features:
        """The same, its large arrays on a shelf, but for the points: those of many frames are asked for again and again."""
        kept = self.kept_faint, self.kept_texture
        faint, texture = (None if one is None else shelve(at_hand(one)) for one in kept)
        learned = None if self.learned is None else self.learned.shelved(shelve)
        shelved = replace(self, kept_descriptors=shelve(self.descriptors), learned=learned)
        return replace(shelved, kept_faint=faint, kept_texture=texture)

    def __getstate__(self) -> list[object]:
        """What is pickled lies on no shelf. Raises OSError if it is lost."""
        faint, texture = (None if one is None else exactly(one) for one in (self.kept_faint, self.kept_texture))
        points, descriptors = exactly(self.kept_points), exactly(self.kept_descriptors)
        whole = replace(self, kept_points=points, kept_descriptors=descriptors, kept_faint=faint, kept_texture=texture)
        return [getattr(whole, field.name) for field in fields(whole)]


def extract(image: Bands, settings: FeatureSettings, reduction: int = 1) -> Features:
    """Features of an image (h, w[, bands]), uint8 or uint16, possibly a frame reduced by an integer factor.

    An image with enough features is used as it is. One with fewer SIFT features than `faint_below`, or with fewer than `count`
    and mostly noise, is faint: features of its contrast-equalised version are added, so that it matches both faint frames and
    slightly less faint ones. (The other detectors' thresholds do not measure contrast, and their descriptors do not tolerate
    the change.) One that shows nothing, see `structure`, has none.
    """
    height, width = image.shape[0] * reduction, image.shape[1] * reduction
    counts = _reduced(image, settings.megapixels, settings.band)
    small, mean = _grey(counts, image), _mean_of(counts)
    if shows_nothing(mean, image):
        return replace(_no_features(settings, width, height, width / small.shape[1]), shows_nothing=True)
    found = detect(small, settings.kind, settings.count, settings.contrast)
    features = _features(found, settings, width, height, width / small.shape[1])
    features = replace(features, sharpness=sharpness(image), kept_texture=texture(mean), looks=looks(image, mean))
    least = settings.count if is_noise(small) else min(settings.faint_below, settings.count)
    if settings.kind != "sift" or len(features) >= least:
        return _with_learned(features, small, 1, settings)
    faint = faint_picture(mean)
    both = joined(features, faint_features(faint, features, settings))
    both = replace(both, kept_faint=faint, ordinary=len(features), is_faint=True)
    return _with_learned(both, equalised(faint, FINE_BLUR), HALF, settings)


def _no_features(settings: FeatureSettings, width: int, height: int, scale: float) -> Features:
    nothing = detect(np.zeros((HALF, HALF), np.uint8), settings.kind, settings.count, settings.contrast)
    return _features(nothing, settings, width, height, scale)


def _with_learned(frame: Features, picture: ImageGrey, reduced: int, settings: FeatureSettings) -> Features:
    """With those of a model, if one is given, found in a picture (h, w) that is the feature picture `reduced` times."""
    if settings.model is None:
        return frame
    detector = _detector(settings.model)
    if detector is None:
        return frame
    found = detector.find(picture, settings.count)
    scale = frame.scale * reduced
    points = ((found.points + 0.5) * scale - 0.5).astype(np.float32)
    return replace(frame, learned=Features(points, found.descriptors, frame.width, frame.height, frame.scale))


@lru_cache(2)
def _detector(model: str) -> LearnedDetector | None:
    """One for a process: it holds a net. None, once and for all, if its file is gone: no frame is lost by that."""
    try:
        return read_detector(Path(model))
    except UnusableModel as error:
        logger.warning("frames go without learned features: %s", error)
        return None


def model_digest(settings: FeatureSettings) -> str | None:
    """Hex of a hash over the file of the learned model; None without one, or if it cannot be read."""
    detector = None if settings.model is None else _detector(settings.model)
    return None if detector is None else detector.digest


def faint_features(standing_out: Band, frame: Features, settings: FeatureSettings) -> Features:
    """Features of a frame's faint picture `standing_out` (h, w), with or without its fixed pattern removed."""
    found = detect_faint(standing_out, settings.kind, settings.count, settings.contrast)
    features = _features(found, settings, frame.width, frame.height, frame.scale)
    features = replace(features, sharpness=frame.sharpness, kept_texture=frame.kept_texture, is_faint=True)
    return within(without_border(features, frame.dead), frame.area)


def joined(one: Features, other: Features) -> Features:
    """Features of one frame from two detections; everything else is taken from the first."""
    points, descriptors = (
        np.concatenate([getattr(f, part) for f in (one, other)]) for part in ("points", "descriptors")
    )
    return replace(one, kept_points=points, kept_descriptors=descriptors)


def without_border(features: Features, dead: DeadBorder) -> Features:
    """Features whose support does not touch a dead border, given in full-resolution pixels."""
    if dead == NO_BORDER:
        return features
    kept = dead.spares(features.points, features.width, features.height, REACH * features.scale)
    return replace(_chosen(features, kept), dead=dead)


def within(features: Features, area: PictureArea | None) -> Features:
    """Features whose support lies within what a frame holds of a picture, and a texture that is 0 outside of it."""
    if area is None:
        return features
    kept = area.spares(features.points, features.width, features.height, REACH * features.scale)
    learned, texture = features.learned, None if features.kept_texture is None else at_hand(features.kept_texture)
    texture = None if texture is None else np.where(area.pixels(*texture.shape), texture, np.int8(0))
    learned = None if learned is None else within(learned, area)
    return replace(_chosen(features, kept), area=area, learned=learned, kept_texture=texture)


def without_overlay(features: Features, still: StillMask) -> Features:
    """Features whose support touches no overlay, and a texture that is 0 there."""
    chosen = _chosen(features, ~still.covers(features.points, features.width, features.height))
    return with_overlay(chosen, still)


def with_overlay(features: Features, still: StillMask) -> Features:
    """All the features, of which those that an overlay covers will not be matched; their numbers stay."""
    learned = None if features.learned is None else replace(features.learned, still=still)
    return replace(features, still=still, learned=learned)


def _chosen(features: Features, kept: Mask) -> Features:
    """Some of a frame's features (n,)."""
    ordinary = int(kept[: features.ordinary].sum())
    points, descriptors = features.points[kept], features.descriptors[kept]
    return replace(features, kept_points=points, kept_descriptors=descriptors, ordinary=ordinary)


def reduced_grey(image: Bands, megapixels: float, band: int = 0) -> ImageGrey:
    """Grey copy of an image (h, w[, bands]), reduced (never enlarged) to about so many megapixels: luminance of a colour image,
    else the selected band or the mean of all. 8-bit images with one or three bands are used unstretched."""
    return _grey(_reduced(image, megapixels, band), image)


def _features(found: Found, settings: FeatureSettings, width: int, height: int, scale: float) -> Features:
    points = (found.points + 0.5) * scale - 0.5
    return Features(points.astype(np.float32), COMPARABLE[settings.kind](found.descriptors), width, height, scale)


def _reduced(image: Bands, megapixels: float, band: int) -> Bands:
    """The bands that grey is made of, (h, w, bands), in the counts of the image."""
    bands = image if image.ndim == 3 else image[..., None]
    factor = min(1.0, math.sqrt(megapixels * 1e6 / (bands.shape[0] * bands.shape[1])))
    size = (max(1, round(bands.shape[1] * factor)), max(1, round(bands.shape[0] * factor)))
    count = bands.shape[2]
    if count == 3:
        bands = cv2.cvtColor(bands, cv2.COLOR_BGR2GRAY)[..., None]
    elif 1 <= band <= count:
        bands = bands[..., band - 1 : band]
    return resized(bands, size) if factor < 1 else bands


def _grey(small: Bands, image: Bands) -> ImageGrey:
    if small.dtype == np.uint8 and (image.ndim == 2 or image.shape[2] in (1, 3)):
        return np.ascontiguousarray(small[..., 0])
    # A thermal scene may span a hundredth of the camera's range, and bands differ in brightness by factors.
    alike = [stretched(small[..., k]) for k in range(small.shape[2])]
    return alike[0] if len(alike) == 1 else np.asarray(np.rint(np.mean(alike, axis=0)), dtype=np.uint8)


def _mean_of(small: Bands) -> FloatImage:
    """Mean (h, w) of bands, each normalised by its own range; not rounded, to keep 16-bit precision."""
    levels = small.astype(np.float32)
    if small.shape[2] > 1:
        low, high = np.quantile(levels, (0.005, 0.995), axis=(0, 1)).astype(np.float32)
        levels = (levels - low) * (np.float32(255) / np.maximum(high - low, np.float32(1)))
    return np.asarray(levels.mean(axis=2), dtype=np.float32)


def root_sift(descriptors: Descriptors) -> NDArray[np.uint8]:
    """SIFT descriptors (n, 128) as RootSIFT, unit length times 255 in bytes: a quarter of the memory, same matches."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    return np.asarray(np.rint(255 * np.sqrt(descriptors / total)), dtype=np.uint8)


def signs(descriptors: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Binary descriptors (n, d) bytes as (n, 8 d) of 1 and -1."""
    return np.unpackbits(descriptors, axis=1).astype(np.int8) * np.int8(2) - np.int8(1)


COMPARABLE: dict[FeatureKind, Callable[[Descriptors], Descriptors]] = {
    "sift": root_sift,
    "orb": signs,
    "surf": rounded,
}
