"""Whether colours are those of a thermal camera's palette that is brighter the warmer something is, such as ironbow or inferno.

Then the mean of the bands tells what is warm. Each of its colours has a brightness of its own; a rainbow has several colours of
one brightness, and of these nobody knows which is warmer.
"""

from __future__ import annotations

import numpy as np

from gcs_mosaic.render.exposure import is_false_colour
from gcs_mosaic.stitch.arrays import Levels

STEPS = 32  # of brightness
# Of the variance of hues, that brightness does not explain: 0.05 to 0.24 of inferno, magma, plasma, viridis, hot, ironbow and a
# camera's own iron red, over thermal frames as JPEGs; 0.46 and more of rainbow, turbo, jet, cool and hsv.
MOST_BESIDE = 0.33


def is_brighter_where_warmer(some: Levels) -> bool:
    """Of a sample of a picture (h, w, bands) in grey levels. Neither a palette that is dark where it is warm nor a small part of
    a rainbow is told apart."""
    if not is_false_colour(some):
        return False
    colours = some.reshape(-1, 3).astype(np.float64)
    brightness = colours.mean(axis=1)
    hues = colours - brightness[:, None]
    step = np.digitize(brightness, np.quantile(brightness, np.arange(1, STEPS) / STEPS))
    counts = np.maximum(np.bincount(step, minlength=STEPS), 1)
    means = np.stack([np.bincount(step, hues[:, band], STEPS) / counts for band in range(3)], axis=1)
    beside = ((hues - means[step]) ** 2).sum()
    return float(beside) < MOST_BESIDE * float(((hues - hues.mean(axis=0)) ** 2).sum())
