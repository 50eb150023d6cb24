"""Integrals of `canopy` to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.integral.forms import mean
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid_together
from sitl.targets import Target
from tests.benchmarks.canopy_scene import Units
from tests.benchmarks.canopy_scores import may_see, taken


def write_pictures(
    folder: Path, hidden: float, looks: Sequence[GroundLook], who: Target, units: Units, height: float
) -> None:
    """The integral of all looks about one person, and of five, and one look."""
    folder.mkdir(parents=True, exist_ok=True)
    x, y = units.canvas(*who.place(0.0))
    window = GroundWindow(float(x), float(y), 30 / units.metres, 360)
    for count in (5, 20, 30):
        stack = laid_together([one for one in taken(looks, count) if may_see(one, window)], window, height)
        write(folder / f"{hidden:.0%}-{count}.png", mean(stack))
    whole = [one for one in stack.values if np.isfinite(one).all()]
    if whole:
        write(folder / f"{hidden:.0%}-1.png", whole[len(whole) // 2])


def write(path: Path, values: NDArray[np.float32]) -> None:
    low, high = np.nanquantile(values, (0.002, 0.999))
    levels = np.nan_to_num(np.clip((values - low) / max(high - low, 1e-3) * 255, 0, 255))
    cv2.imwrite(str(path), levels.astype(np.uint8))
