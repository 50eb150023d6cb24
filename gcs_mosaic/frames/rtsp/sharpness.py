"""How sharp a picture is, compared with others of the same view."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_BLOCKS = (24, 18)  # over the picture, columns and rows


def sharpness(grey: NDArray[np.uint8]) -> float:
    """Energy of the Laplacian (Nayar and Nakagawa 1994) of the middle one of many blocks: what stands out with hard edges,
    such as text that the camera writes into its pictures, must not hide that everything else is blurred."""
    laplacian = cv2.Laplacian(grey, cv2.CV_32F)
    return float(np.median(cv2.resize(laplacian * laplacian, _BLOCKS, interpolation=cv2.INTER_AREA)))
