"""Which placed frames to match a new one with, once its rough position is known."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import Box4, BoxesNx4, Indices, Mask, PointsNx2, Vector
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid, pixels_from_canvas

REGION_FACTOR = 3.0  # the paper's region of interest: the box of the last frame, three times as large
SECTORS = 6  # directions over which neighbours are spread


def region_of_interest(box: Box4) -> Box4:
    """The box (4,) enlarged about its centre."""
    centre, half = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2
    return np.concatenate([centre - REGION_FACTOR * half, centre + REGION_FACTOR * half])


def boxes_meet(box: Box4, boxes: BoxesNx4) -> Mask:
    """Which of the boxes (n, 4) intersect the box (4,); NaN intersects nothing."""
    return np.asarray((boxes[:, :2] < box[2:]).all(axis=1) & (boxes[:, 2:] > box[:2]).all(axis=1))


def boxes_shared(box: Box4, boxes: BoxesNx4) -> Vector:
    """Share (n,) of the box (4,) that each of the boxes (n, 4) covers, 0 to 1; they must intersect it."""
    sides = np.minimum(boxes[:, 2:], box[2:]) - np.maximum(boxes[:, :2], box[:2])
    return np.asarray(sides.prod(axis=1) / max((box[2:] - box[:2]).prod(), 1e-12))


def overlap(pose: Pose, camera: Camera, other_pose: Pose, other_camera: Camera) -> float:
    """Share of the frame's pixels that the other frame sees too, 0 to 1."""
    places = canvas_from_pixels(pose, camera, pixel_grid(camera, 9, 7))
    seen = pixels_from_canvas(other_pose, other_camera, places)
    with np.errstate(invalid="ignore"):
        inside = ((seen >= -0.5) & (seen < [other_camera.width - 0.5, other_camera.height - 0.5])).all(axis=1)
    return float(inside.mean())


def spread_choice(overlaps: Vector, bearings: Vector, count: int) -> Indices:
    """At most `count` indices (k,) of frames with overlap (n,), round-robin over directions, best overlap first."""
    sector = np.floor((bearings + np.pi) / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    rank = np.zeros(len(overlaps), int)
    for s in range(SECTORS):
        inside = np.flatnonzero(sector == s)
        rank[inside[np.argsort(-overlaps[inside], kind="stable")]] = np.arange(len(inside))
    order = np.lexsort((-overlaps, rank))
    return order[:count]


def seen_by(pixels: PointsNx2, pose: Pose, camera: Camera, other_pose: Pose, other_camera: Camera) -> Mask:
    """Which pixels (n, 2) of a frame the other one sees, with a margin for rough poses."""
    seen = pixels_from_canvas(other_pose, other_camera, canvas_from_pixels(pose, camera, pixels))
    margin = MARGIN * other_camera.half_diagonal
    with np.errstate(invalid="ignore"):
        return np.asarray(
            ((seen > -margin) & (seen < [other_camera.width + margin, other_camera.height + margin])).all(1)
        )


MARGIN = 0.1  # half-diagonals
