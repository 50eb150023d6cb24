"""Displacement of painted frames from their present poses."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import PointsNx2
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, on_plane
from gcs_mosaic.stitch.graph.placement import Placement


def displacement(painted: RenderItem, placement: Placement) -> float:
    """Maximum displacement of the painted frame from its placement, in the frame's own pixels."""
    if painted.island != placement.island:
        return np.inf
    there = _places(painted.pose, painted.camera, painted.relief)
    here = _places(placement.pose, placement.camera, placement.relief)
    off = np.linalg.norm(there - here, axis=1) / np.exp(placement.pose.log_gsd)
    return float(np.nanmax(off)) if np.isfinite(off).any() else np.inf


def _places(pose: Pose, camera: Camera, relief: ReliefDisplacement | None) -> PointsNx2:
    """Canvas places of points all over the frame, (n, 2); NaN above the horizon. They are fixed fractions of the frame,
    independent of the image size."""
    x, y = np.meshgrid(np.linspace(0, 1, 9) * camera.width - 0.5, np.linspace(0, 1, 7) * camera.height - 0.5)
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    return canvas_from_pixels(pose, camera, on_plane(relief, camera, pixels))
