"""A small textured ground and frames cut from it at known poses."""

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid, similarity_between
from gcs_mosaic.stitch.graph.placement import Outcome, Placement
from gcs_mosaic.stitch.mosaic import Mosaic

Image = NDArray[np.uint8]

SMALL_CAMERA = Camera(480, 360, 1.5, 0.0)


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


def fly(mosaic: Mosaic, ground: Image, poses: Iterable[Pose], first: int = 0) -> list[Outcome]:
    """Take pictures of the ground at these poses, called by their numbers from `first` on, and add them to the mosaic."""
    outcomes = []
    for i, pose in enumerate(poses, start=first):
        outcomes.append(mosaic.add(photograph(ground, pose, SMALL_CAMERA), f"{i:03}"))
        mosaic.adjust()
    return outcomes


def map_error(placements: Sequence[Placement], truth: Sequence[Pose]) -> float:
    """RMS distance from the true places after one similarity, in pixels of the ground."""
    grid = pixel_grid(SMALL_CAMERA, 5, 4)
    found = np.concatenate([canvas_from_pixels(p.pose, p.camera, grid) for p in placements])
    true = np.concatenate([canvas_from_pixels(truth[int(p.name)], SMALL_CAMERA, grid) for p in placements])
    scale, angle, shift = similarity_between(found, true)
    c, s = math.cos(angle), math.sin(angle)
    return float(np.sqrt(((scale * found @ np.array([[c, s], [-s, c]]) + shift - true) ** 2).sum(axis=1).mean()))
