"""A small textured ground and frames cut from it at known poses."""

import math
import zlib
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid, similarity_between
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.graph.placement import Outcome, Placement
from gcs_mosaic.stitch.mosaic import Mosaic

Image = NDArray[np.uint8]

SMALL_CAMERA = Camera(480, 360, 1.5, 0.0)
MOST_SEEN = 100  # frames, of a megabyte each
SEEN: dict[tuple[int, Pose, FeatureSettings], Features] = {}


def textured_ground(size: int, seed: int) -> Image:
    """A grey picture (size, size) with structure at every scale, so that features are found at every height."""
    rng = np.random.default_rng(seed)
    ground = np.zeros((size, size), np.float32)
    for cell in (2, 4, 8, 16, 64):
        noise = rng.normal(size=(size // cell + 2, size // cell + 2)).astype(np.float32)
        ground += cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC) * cell**0.5
    return np.asarray(cv2.normalize(ground, np.empty_like(ground), 0, 255, cv2.NORM_MINMAX), np.uint8)


def photograph(ground: Image, pose: Pose, camera: Camera) -> Image:
    """What a camera at this pose sees of the ground, whose pixels are the canvas units; grey where it ends."""
    places = canvas_from_pixels(pose, camera, pixel_grid(camera, camera.width, camera.height)).astype(np.float32)
    maps = np.nan_to_num(places, nan=-1e6).reshape(camera.height, camera.width, 2)
    return np.asarray(cv2.remap(ground, maps, None, cv2.INTER_LINEAR, borderValue=128))  # type: ignore[call-overload]


def seen(ground: Image, pose: Pose, settings: FeatureSettings) -> Features:
    """What SMALL_CAMERA finds at this pose, which is kept: many tests fly the same line over the same ground."""
    key = zlib.crc32(ground.tobytes()), pose, settings
    if key not in SEEN:
        if len(SEEN) == MOST_SEEN:
            SEEN.pop(next(iter(SEEN)))
        SEEN[key] = extract(photograph(ground, pose, SMALL_CAMERA), settings)
    return SEEN[key]


def fly(mosaic: Mosaic, ground: Image, poses: Iterable[Pose], first: int = 0) -> list[Outcome]:
    """Take pictures of the ground at these poses, called by their numbers from `first` on, and add them to the mosaic."""
    outcomes = []
    for i, pose in enumerate(poses, start=first):
        outcomes.append(mosaic.place(seen(ground, pose, mosaic.settings.features), f"{i:03}"))
        mosaic.adjust()
    return outcomes


def map_error(placements: Sequence[Placement], truth: Sequence[Pose], camera: Camera = SMALL_CAMERA) -> float:
    """RMS distance from the true places after one similarity, in pixels of the ground."""
    grid = pixel_grid(camera, 5, 4)
    found = np.concatenate([canvas_from_pixels(p.pose, p.camera, grid) for p in placements])
    true = np.concatenate([canvas_from_pixels(truth[int(p.name)], camera, grid) for p in placements])
    scale, angle, shift = similarity_between(found, true)
    c, s = math.cos(angle), math.sin(angle)
    return float(np.sqrt(((scale * found @ np.array([[c, s], [-s, c]]) + shift - true) ** 2).sum(axis=1).mean()))
