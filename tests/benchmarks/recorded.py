"""Features of the recorded flights that lie beside the project, if they do."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract

SHARED = Path(__file__).parents[3] / "shared" / "data"
RECORDED = ("caliterra", "copr", "cmac", "brighton", "guangzhou", "deer")
LARGE = 2_000_000  # bytes of a photograph that is read at a quarter of its size


def photographs(flight: str) -> list[Path]:
    """In the order of their names, which is that in which they were taken."""
    return sorted((SHARED / flight).glob("*.[jJ][pP]*"))


@lru_cache(maxsize=512)
def read(path: Path) -> Features:
    """Features of a photograph, found at about 1000 pixels of width."""
    return extract(picture_of(path), FeatureSettings(), _reduction(path))


def picture_of(path: Path) -> ImageBGR:
    """A photograph, a large one at a quarter of its size."""
    flag = cv2.IMREAD_REDUCED_COLOR_4 if _reduction(path) == 4 else cv2.IMREAD_COLOR
    image = cv2.imread(str(path), flag)
    if image is None:
        raise ValueError(f"{path} is no picture that can be read")
    return np.asarray(image, np.uint8)


def _reduction(path: Path) -> int:
    return 4 if path.stat().st_size > LARGE else 1
