"""Pictures that show nothing: a closed shutter, a covered lens, noise.

Averaged over squares, white noise loses three quarters of its variance each time the squares are doubled, whatever its strength.
Ground loses far less: it has things of all sizes. So the differences between neighbouring squares of two sizes tell them apart.
Fine things alone, such as plants, are like noise in that; but they stand in rows, of which noise has none.
"""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, Bands, FloatImage, Matrix

COARSE = (32, 16, 8)  # px, side of the large squares: the first that leaves enough of them
FINER = 8  # times smaller are the small ones
FEWEST_SQUARES = 150  # a variance of fewer is known too badly
# Variance among small squares over that among large ones, as a share of what it is for white noise: 0.09 and less in all recorded
# flights (most over dry grass), 0.64 over plants in rows that nothing else tells apart; 0.9 of noise, before and after JPEG; 0.3
# where ground is a sixth as strong as the noise over it. Nearer to noise: a true frame that is refused costs more than a shutter.
LEAST_LIKE_NOISE = 0.75
# Noise varies from pixel to pixel, too, which soft things do not: variance of pixels over that of squares of two. 4 of white
# noise, 1.2 after a Bayer pattern or JPEG; 0.5 and less of noise that was blurred or enlarged.
WHITE = 1.15
# Deviation of a sensor's noise, in levels or counts: at most; and where compression or a Bayer pattern has smoothed it.
LOUDEST = {"uint8": 40.0, "uint16": 4000.0}
FAINT = {"uint8": 3.0, "uint16": 12.0}
# Power at one frequency over the mean of all that are as fine, in windows of so many pixels: 3.2 and less of noise, a shutter
# after its stripes, JPEG; 17 to 68 over fields in rows.
ROWS_FROM = 8.0
WINDOW = 256
SMOOTHED = 5  # frequencies whose power is averaged
CROP = 512  # px a side, in the middle of the picture as it is: enough to see whether its noise is white


def shows_nothing(small: Band, image: Bands) -> bool:
    """Whether a picture is flat or noise alone. `small`: its grey (h, w) at the size that features are sought at; `image` (h, w[,
    bands]): as it came."""
    grey = small.astype(np.float32)
    if grey.max() == grey.min():
        return True
    sides = [side for side in COARSE if (grey.shape[0] // side) * (grey.shape[1] // side) >= FEWEST_SQUARES]
    if not sides:
        return False
    if image.ndim == 2 or image.shape[2] == 1:
        grey = _without_stripes(grey)  # of a thermal sensor; in colour they are rows of something
    fine = _squares(grey, sides[0] // FINER)
    coarse = _without_shading(_squares(fine, FINER))
    like_noise = _variance(fine) / max(_variance(coarse), 1e-9) / FINER**2
    return like_noise > LEAST_LIKE_NOISE and _is_sensor_noise(image) and not _has_rows(grey)


def _has_rows(grey: FloatImage) -> bool:
    """Whether something repeats in a picture (h, w), a sensor's stripes left out."""
    side = min(WINDOW, *grey.shape)
    taper = np.outer(np.hanning(side), np.hanning(side)).astype(np.float32)
    power = np.zeros((side, side // 2 + 1))
    for top, start in product(
        range(0, grey.shape[0] - side + 1, side // 2), range(0, grey.shape[1] - side + 1, side // 2)
    ):
        window = grey[top : top + side, start : start + side]
        power += np.abs(np.fft.rfft2((window - window.mean()) * taper)) ** 2
    smooth = cv2.blur(np.fft.fftshift(power, axes=0), (SMOOTHED, SMOOTHED))
    down, across = np.indices(smooth.shape)
    ring = np.hypot(down - side // 2, across).astype(np.intp)  # of equal frequency
    mean = np.bincount(ring.ravel(), smooth.ravel()) / np.maximum(np.bincount(ring.ravel()), 1)
    whole = (ring > SMOOTHED) & (ring < side // 2 - SMOOTHED)
    return bool((smooth > ROWS_FROM * mean[ring])[whole].any())


def _is_sensor_noise(image: Bands) -> bool:
    """Whether what varies from pixel to pixel of an image (h, w[, bands]), uint8 or uint16, is as white, or as faint, as a
    sensor's noise."""
    band = image[..., image.shape[2] // 2] if image.ndim == 3 else image
    top, left = (max(0, (size - CROP) // 2) for size in band.shape)
    crop = band[top : top + CROP, left : left + CROP].astype(np.float32)
    deviation, smoothed = (float(np.sqrt(_variance(one))) for one in (crop, _squares(crop, 2)))
    kind = str(image.dtype)
    return deviation < FAINT[kind] or (deviation < LOUDEST[kind] and deviation**2 > WHITE * smoothed**2)


def _squares(grey: FloatImage, side: int) -> FloatImage:
    """Means of squares of so many pixels a side; what is left over at the right and below is left out."""
    rows, columns = grey.shape[0] // side, grey.shape[1] // side
    part = grey[: rows * side, : columns * side]
    return np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _variance(grey: FloatImage) -> float:
    """Half the mean square of the differences between neighbours: the variance, where they are independent."""
    across, down = np.diff(grey, axis=1), np.diff(grey, axis=0)
    return float((across**2).mean() + (down**2).mean()) / 4


def _without_stripes(grey: FloatImage) -> FloatImage:
    """Without the means of rows and columns, in which a thermal sensor's amplifiers differ."""
    return np.asarray(grey - grey.mean(axis=0) - grey.mean(axis=1, keepdims=True) + grey.mean(), np.float32)


def _without_shading(grey: FloatImage) -> FloatImage:
    """Without a polynomial of the fourth degree: a lens' shade, or the warmth of the housing."""
    rows, columns = grey.shape
    y, x = (one.ravel() for one in np.mgrid[-1 : 1 : 1j * rows, -1 : 1 : 1j * columns])
    terms: Matrix = np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=1)
    shade = terms @ np.linalg.lstsq(terms, grey.ravel().astype(np.float64), rcond=None)[0]
    return np.asarray(grey - shade.reshape(rows, columns), np.float32)
