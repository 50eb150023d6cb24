"""Frames of a thermal camera with counts of 16 bits, as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.float32]

WIDTH, HEIGHT = 320, 240
STEP = 110  # px between frames
NOISE = 4.0  # counts
COLD, TARMAC = 27_800.0, 31_000.0


def ground(seed: int, frames: int) -> Counts:
    """A strip that so many frames see: things of all sizes, deviation 1."""
    rng = np.random.default_rng(seed)
    shape = HEIGHT, WIDTH + STEP * (frames - 1)
    total = np.zeros(shape, np.float32)
    for sigma, strength in ((2, 0.5), (5, 0.8), (12, 1.0), (40, 1.5)):
        soft = cv2.GaussianBlur(rng.normal(size=shape).astype(np.float32), (0, 0), sigma)
        total += strength * soft / soft.std()
    for _ in range(12 * frames):
        x, y = int(rng.integers(shape[1])), int(rng.integers(HEIGHT))
        size = rng.integers(6, 40, 2)
        cv2.rectangle(total, (x, y), (x + int(size[0]), y + int(size[1])), float(rng.normal(0, 3)), -1)
    return np.asarray(total / total.std(), np.float32)


def flown(
    frames: int = 6, base: float = COLD, contrast: float = 60.0, seed: int = 5, least: float = 1.0
) -> list[Counts]:
    """Frames along a strip, whose contrast rises from the `least` to that of its end."""
    seen, rng = ground(seed, frames), np.random.default_rng(seed + 1)
    seen = seen * np.linspace(least, 1, seen.shape[1], dtype=np.float32)
    noise = rng.normal(0, NOISE, (frames, HEIGHT, WIDTH)).astype(np.float32)
    return [base + contrast * seen[:, STEP * k : STEP * k + WIDTH] + noise[k] for k in range(frames)]


def tarmac() -> Counts:
    """A frame of warm tarmac on the apron."""
    return flown(1, TARMAC, 75.0, seed=9)[0]


def shutter(base: float = 30_000.0, noise: float = 6.0, seed: int = 3) -> Counts:
    """A closed shutter: noise, columns that differ, and the shade of a warm housing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-1 : 1 : 1j * HEIGHT, -1 : 1 : 1j * WIDTH]
    shade = 20 * (x**2 + y**2) + rng.normal(0, noise / 2, WIDTH)
    return np.asarray(base + shade + rng.normal(0, noise, (HEIGHT, WIDTH)), np.float32)


def with_fire(frame: Counts) -> Counts:
    """One hot thing in it."""
    burning = frame.copy()
    burning[100:130, 150:180] = 38_000
    return burning


def written(folder: Path, frames: Sequence[Counts]) -> Path:
    """The frames as TIFFs in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(frames):
        counts = np.clip(np.rint(one), 0, 65_535).astype(np.uint16)
        assert cv2.imwrite(str(folder / f"T_{number:04}.tif"), counts)
    return folder
