"""Small frames and what is known about them."""

import cv2
import numpy as np

from gcs_mosaic.render.painted import Painted
from gcs_mosaic.render.warp_grid import own_level
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement

SMALL = Camera(160, 120, focal=1.2, k1=-0.02)


def picture(seed: int, camera: Camera = SMALL) -> np.ndarray:
    """Ground with both smooth places and dense edges."""
    rng = np.random.default_rng(seed)
    rough = rng.integers(0, 255, (camera.height, camera.width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 12)
    left = np.arange(camera.width)[None, :, None] < camera.width / 2
    return np.where(left, cv2.GaussianBlur(rough, (0, 0), 1.0), smooth).astype(np.uint8)


def hilly(seed: int) -> ReliefDisplacement:
    """Shifts of some three pixels of SMALL."""
    return ReliefDisplacement.from_grid(np.random.default_rng(seed).normal(0, 0.03, (4, 5, 2)))


def painted(order: int, x: float = 0.0, y: float = 0.0, *, gsd: float = 1.0, yaw: float = 0.0, **more) -> Painted:
    """Frame number `order` of a small camera; `more` are other fields of Painted, or `pitch`, `roll`, `camera`."""
    pose = Pose(x, y, float(np.log(gsd)), yaw, more.pop("pitch", 0.0), more.pop("roll", 0.0))
    camera = more.pop("camera", SMALL)
    more.setdefault("level", own_level(pose, camera))
    return Painted(name=f"{order}.jpg", order=order, pose=pose, camera=camera, **{"island": 0, **more})
