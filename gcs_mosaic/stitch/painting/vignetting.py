"""Frames are darker towards their corners: how much, told from what overlapping frames see of the same ground.

One radial curve per camera: the log of the brightness at r half-diagonals from the middle is a r**2 + b r**4, as in D. Goldman,
"Vignette and Exposure Calibration and Compensation", PAMI 32(12), 2010. Ground that one frame sees in its middle and another
one at its border tells a and b; the exposures, one per frame, drop out with the mean of each pair of frames. A prior keeps the
curve flat where overlaps do not tell it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vignetting = tuple[float, float]  # a, b

FLAT: Vignetting = (0.0, 0.0)
UNLIKE = 0.25  # log brightness; pixels that differ by more from what is usual in an overlap show something else


@dataclass(frozen=True, slots=True, kw_only=True)
class VignettingSettings:
    """How strongly the curve follows what is seen in overlaps."""

    # Of a and b; 0.3 is a corner at three quarters of the brightness of the middle.
    sigma: float = 0.3
    # Log brightness by which a thumbnail pixel of two frames differs; large, because its neighbours differ alike.
    pixel_sigma: float = 1.0


@dataclass(frozen=True, slots=True)
class RadialSums:
    """What one overlap tells: means (2,) of r**2 and r**4 in both frames; and, of the differences of these and of the log
    brightness about their means, the sums of products (2, 2) and (2,)."""

    mean_i: tuple[float, float]
    mean_j: tuple[float, float]
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the upper half: a a, a b, b b
    wanted: tuple[float, float] = (0.0, 0.0)


NO_SUMS = RadialSums((0.0, 0.0), (0.0, 0.0))


@dataclass(frozen=True, slots=True)
class VignettingEstimate:
    """The curve of one camera, from all overlaps so far."""

    settings: VignettingSettings = field(default_factory=VignettingSettings)
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)  # summed as in RadialSums
    wanted: tuple[float, float] = (0.0, 0.0)

    def after(self, sums: RadialSums) -> VignettingEstimate:
        """The estimate with what one more overlap tells."""
        (aa, ab, bb), (to_a, to_b) = self.products, self.wanted
        products = aa + sums.products[0], ab + sums.products[1], bb + sums.products[2]
        return replace(self, products=products, wanted=(to_a + sums.wanted[0], to_b + sums.wanted[1]))

    @property
    def curve(self) -> Vignetting:
        prior = np.eye(2) * (self.settings.pixel_sigma / self.settings.sigma) ** 2
        aa, ab, bb = self.products
        a, b = np.linalg.solve(np.array([[aa, ab], [ab, bb]]) + prior, np.array(self.wanted)).tolist()
        return a, b


def radii(pixels: Array, width: int, height: int) -> Array:
    """r**2 and r**4 (n, 2) of pixels (n, 2) of a frame."""
    squared = (((pixels - [(width - 1) / 2, (height - 1) / 2]) / (np.hypot(width, height) / 2)) ** 2).sum(axis=1)
    return np.stack([squared, squared**2], axis=1)


def radial_sums(at_i: Array, at_j: Array, log_ratio: Array) -> RadialSums:
    """Of pixels that two frames share: `radii` (n, 2) of each in both, and log brightness of i less that of j (n,)."""
    alike = np.abs(log_ratio - np.median(log_ratio)) < UNLIKE
    apart = (at_i - at_j)[alike]
    apart -= apart.mean(axis=0)
    (aa, ab), (_, bb) = (apart.T @ apart).tolist()
    to_a, to_b = (apart.T @ (log_ratio[alike] - log_ratio[alike].mean())).tolist()
    (a_i, b_i), (a_j, b_j) = at_i.mean(axis=0).tolist(), at_j.mean(axis=0).tolist()
    return RadialSums((a_i, b_i), (a_j, b_j), (aa, ab, bb), (to_a, to_b))


def log_brightness(vignetting: Vignetting, at: tuple[float, float]) -> float:
    """Of a place where r**2 and r**4 are so, against the middle."""
    return vignetting[0] * at[0] + vignetting[1] * at[1]


def brightening(vignetting: Vignetting, pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """What takes the vignetting out (h, w) at pixels (h, w, 2) of a frame; 1 where nowhere (NaN)."""
    at = radii(pixels.reshape(-1, 2).astype(np.float64), width, height) @ vignetting
    return np.nan_to_num(np.exp(-np.clip(at, -1, 1)), nan=1.0).astype(np.float32).reshape(pixels.shape[:2])


def brightening_map(vignetting: Vignetting, width: int, height: int) -> NDArray[np.float32]:
    """The same for a whole picture of a frame, (height, width), of any size."""
    x, y = (np.arange(count) * (side / count) + side / count / 2 - 0.5 for count, side in ((64, width), (48, height)))
    coarse = brightening(vignetting, np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32), width, height)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def brightened(picture: NDArray[np.uint8], factor: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A picture (h, w, 3) times a factor (h, w)."""
    return np.asarray(cv2.multiply(picture, cv2.merge([factor] * 3), dtype=cv2.CV_8U), dtype=np.uint8)
