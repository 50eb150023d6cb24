"""Small frames and what is known about them."""

from typing import TypedDict, Unpack

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.display import Display
from gcs_mosaic.render.light_field import LightField
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.vignetting import Vignetting
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.camera.still_mask import StillMask
from tests.tile_parts import own_level

SMALL = Camera(160, 120, focal=1.2, k1=-0.02)


def picture(seed: int, camera: Camera = SMALL) -> NDArray[np.uint8]:
    """Ground with both smooth places and dense edges."""
    rng = np.random.default_rng(seed)
    rough = rng.integers(0, 255, (camera.height, camera.width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 12)
    left = np.arange(camera.width)[None, :, None] < camera.width / 2
    return np.where(left, cv2.GaussianBlur(rough, (0, 0), 1.0), smooth).astype(np.uint8)


def hilly(seed: int) -> ReliefDisplacement:
    """Shifts of some three pixels of SMALL."""
    return ReliefDisplacement.from_grid(np.random.default_rng(seed).normal(0, 0.03, (4, 5, 2)))


class Looks(TypedDict, total=False):
    """Fields of RenderItem that `painted` leaves as they are."""

    relief: ReliefDisplacement | None
    gain: tuple[float, ...]
    vignetting: Vignetting
    light: LightField | None
    display: Display
    dead: DeadBorder
    still: StillMask | None


def painted(
    order: int,
    x: float = 0.0,
    y: float = 0.0,
    *,
    gsd: float = 1.0,
    yaw: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
    camera: Camera = SMALL,
    island: int = 0,
    level: int | None = None,
    **looks: Unpack[Looks],
) -> RenderItem:
    """Frame number `order` of a small camera, at its own level if none is given."""
    pose = Pose(x, y, float(np.log(gsd)), yaw, pitch, roll)
    level = own_level(pose, camera) if level is None else level
    return RenderItem(name=f"{order}.jpg", order=order, island=island, pose=pose, camera=camera, level=level, **looks)
