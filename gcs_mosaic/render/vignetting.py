"""Vignetting: radial brightness fall-off, estimated from overlapping frames.

One radial curve per camera and band, because many lenses also tint the centre relative to the corners: the log brightness at r
half-diagonals from the centre is a r + b r**2 + c r**4. The even powers are those of D. Goldman, "Vignette and Exposure
Calibration and Compensation", PAMI 32(12), 2010; the first models a central spot, left by cameras that correct the shading of a
different lens. Ground seen by one frame at its centre and by another at its border determines the curve; the exposures, one per
frame, cancel with the mean of each pair of frames. A prior keeps it flat where overlaps do not determine it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gcs_mosaic.stitch.arrays import Lattice, Matrix, PointsNx2, RowsNx3, Vector

Curve = tuple[float, float, float]  # a, b, c
Vignetting = tuple[Curve, ...]  # one per band

FLAT: Vignetting = ()  # for any number of bands
OUTWARDS: RowsNx3 = np.linspace(0, 1, 33)[:, None] ** [1, 2, 4]  # `radii` from the centre to a corner
MEAN: Vector = np.array([0.539, 1 / 3, 0.159])  # of `radii` over a frame of 4:3; other shapes differ by less than 0.02
UNLIKE = 0.25  # log brightness; pixels that deviate more from the overlap's median show something else


@dataclass(frozen=True, slots=True, kw_only=True)
class VignettingSettings:
    """How strongly the curve follows the overlaps."""

    # Of a, b and c, which partly cancel where the centre is dark: larger than any change of the curve itself.
    sigma: float = 1.0
    # Log brightness difference of a thumbnail pixel between two frames; large, because neighbouring pixels are correlated.
    pixel_sigma: float = 1.0


@dataclass(frozen=True, slots=True)
class RadialSums:
    """Statistics of one overlap: means of `radii` in both frames; and, of the centred differences of these and of the log
    brightness, the sums of products (3, 3) and, by band, (3,)."""

    mean_i: Curve
    mean_j: Curve
    products: tuple[Curve, ...] = ()
    wanted: tuple[Curve, ...] = ()


NO_SUMS = RadialSums((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class VignettingEstimate:
    """The curves of one camera, from all overlaps so far."""

    settings: VignettingSettings = field(default_factory=VignettingSettings)
    products: tuple[Curve, ...] = ()  # sums as in RadialSums
    wanted: tuple[Curve, ...] = ()

    def after(self, sums: RadialSums) -> VignettingEstimate:
        """The estimate after one more overlap."""
        if not self.wanted:
            return replace(self, products=sums.products, wanted=sums.wanted)
        products, wanted = np.add(self.products, sums.products), np.add(self.wanted, sums.wanted)
        return replace(self, products=_curves(products), wanted=_curves(wanted))

    @property
    def curves(self) -> Vignetting:
        if not self.wanted:
            return FLAT
        prior = np.eye(3) * (self.settings.pixel_sigma / self.settings.sigma) ** 2
        return _curves(np.linalg.solve(np.array(self.products) + prior, np.array(self.wanted).T).T)


def _curves(rows: RowsNx3) -> tuple[Curve, ...]:
    return tuple((a, b, c) for a, b, c in rows.tolist())


def radii(pixels: PointsNx2, width: int, height: int) -> RowsNx3:
    """r, r**2 and r**4 (n, 3) of pixels (n, 2) of a frame."""
    half = np.hypot(width, height) / 2
    squared = ((pixels[:, 0] - (width - 1) / 2) / half) ** 2 + ((pixels[:, 1] - (height - 1) / 2) / half) ** 2
    return np.stack([np.sqrt(squared), squared, squared**2], axis=1)


def radial_sums(at_i: RowsNx3, at_j: RowsNx3, log_ratio: Matrix) -> RadialSums:
    """Statistics of pixels shared by two frames: `radii` (n, 3) in each, and log brightness of i minus that of j (n, bands)."""
    grey = log_ratio.mean(axis=1)
    alike = np.abs(grey - np.median(grey)) < UNLIKE
    apart = (at_i - at_j)[alike]
    apart -= apart.mean(axis=0)
    wanted = (log_ratio[alike] - log_ratio[alike].mean(axis=0)).T @ apart
    (mean_i,), (mean_j,) = (_curves(at.mean(axis=0, keepdims=True)) for at in (at_i, at_j))
    return RadialSums(mean_i, mean_j, _curves(apart.T @ apart), _curves(wanted))


def log_brightness(vignetting: Vignetting, at: RowsNx3) -> Matrix:
    """Log brightness (n, bands), or (n, 1) for all bands, at places with these `radii` (n, 3). Relative to the mean of each band
    over a frame: without its vignetting it has the colours and the brightness that it was taken with."""
    curves = np.array(vignetting or [(0.0, 0.0, 0.0)])
    return np.asarray((curves @ at.T - (curves @ MEAN)[:, None]).T)  # in rows: numpy is slow along an axis of three


def brightening(vignetting: Vignetting, pixels: Lattice, width: int, height: int) -> Lattice:
    """Factor (h, w, bands) that removes the vignetting at pixels (h, w, 2) of a frame; 1 where nowhere (NaN)."""
    at = log_brightness(vignetting, radii(pixels.reshape(-1, 2).astype(np.float64), width, height))
    factors = np.nan_to_num(np.exp(-np.clip(at, -1, 1)), nan=1.0).astype(np.float32)
    return np.asarray(factors.reshape(*pixels.shape[:2], -1))
