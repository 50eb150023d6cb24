"""Frames are darker towards their corners: how much, told from what overlapping frames see of the same ground.

One radial curve per camera and band, because many a lens also gives the middle another colour than the corners: the log of
the brightness at r half-diagonals from the middle is a r**2 + b r**4, as in D. Goldman, "Vignette and Exposure Calibration
and Compensation", PAMI 32(12), 2010. Ground that one frame sees in its middle and another one at its border tells a and b;
the exposures, one per frame, drop out with the mean of each pair of frames. A prior keeps the curve flat where overlaps do
not tell it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curve = tuple[float, float]  # a, b
Vignetting = tuple[Curve, ...]  # one for each band

FLAT: Vignetting = ()  # whatever bands there are
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
    brightness about their means, the sums of products (2, 2) and, by band, (2,)."""

    mean_i: tuple[float, float]
    mean_j: tuple[float, float]
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the upper half: a a, a b, b b
    wanted: tuple[Curve, ...] = ()


NO_SUMS = RadialSums((0.0, 0.0), (0.0, 0.0))


@dataclass(frozen=True, slots=True)
class VignettingEstimate:
    """The curves of one camera, from all overlaps so far."""

    settings: VignettingSettings = field(default_factory=VignettingSettings)
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)  # summed as in RadialSums
    wanted: tuple[Curve, ...] = ()

    def after(self, sums: RadialSums) -> VignettingEstimate:
        """The estimate with what one more overlap tells."""
        aa, ab, bb = self.products
        known = self.wanted or ((0.0, 0.0),) * len(sums.wanted)
        products = aa + sums.products[0], ab + sums.products[1], bb + sums.products[2]
        wanted = tuple((a + more_a, b + more_b) for (a, b), (more_a, more_b) in zip(known, sums.wanted, strict=True))
        return replace(self, products=products, wanted=wanted)

    @property
    def curves(self) -> Vignetting:
        prior = np.eye(2) * (self.settings.pixel_sigma / self.settings.sigma) ** 2
        aa, ab, bb = self.products
        normal = np.array([[aa, ab], [ab, bb]]) + prior
        return tuple((a, b) for a, b in (np.linalg.solve(normal, np.array(one)).tolist() for one in self.wanted))


def radii(pixels: Array, width: int, height: int) -> Array:
    """r**2 and r**4 (n, 2) of pixels (n, 2) of a frame."""
    squared = (((pixels - [(width - 1) / 2, (height - 1) / 2]) / (np.hypot(width, height) / 2)) ** 2).sum(axis=1)
    return np.stack([squared, squared**2], axis=1)


def radial_sums(at_i: Array, at_j: Array, log_ratio: Array) -> RadialSums:
    """Of pixels that two frames share: `radii` (n, 2) of each in both, and log brightness of i less that of j (n, bands)."""
    grey = log_ratio.mean(axis=1)
    alike = np.abs(grey - np.median(grey)) < UNLIKE
    apart = (at_i - at_j)[alike]
    apart -= apart.mean(axis=0)
    (aa, ab), (_, bb) = (apart.T @ apart).tolist()
    wanted = (log_ratio[alike] - log_ratio[alike].mean(axis=0)).T @ apart
    (a_i, b_i), (a_j, b_j) = at_i.mean(axis=0).tolist(), at_j.mean(axis=0).tolist()
    return RadialSums((a_i, b_i), (a_j, b_j), (aa, ab, bb), tuple((a, b) for a, b in wanted.tolist()))


def log_brightness(vignetting: Vignetting, at: tuple[float, float]) -> Array:
    """Of a place where r**2 and r**4 are so, against the middle: (bands,), or (1,) for all of them."""
    return np.array(vignetting or [(0.0, 0.0)]) @ at


def brightening(vignetting: Vignetting, pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """What takes the vignetting out (h, w, bands) at pixels (h, w, 2) of a frame; 1 where nowhere (NaN)."""
    at = radii(pixels.reshape(-1, 2).astype(np.float64), width, height) @ np.array(vignetting).T
    factors = np.nan_to_num(np.exp(-np.clip(at, -1, 1)), nan=1.0).astype(np.float32)
    return np.asarray(factors.reshape(*pixels.shape[:2], -1))
