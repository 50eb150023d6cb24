"""Similarity transform (rotation, uniform scale, translation) between two point sets."""

from __future__ import annotations

import numpy as np

from .warp import Floats

ROBUST_STEPS = 40


def robust_similarity(source: Floats, target: Floats) -> Floats:
    """3x3 target_from_source: least squares, iteratively reweighted towards the least sum of distances, so that a few
    misplaced frames do not bias the fit."""
    if len(source) < 2:
        return np.full((3, 3), np.nan)
    weights = np.ones(len(source))
    for _ in range(ROBUST_STEPS):
        target_from_source = similarity(source, target, weights)
        away = lengths(source @ target_from_source[:2, :2].T + target_from_source[:2, 2] - target)
        weights = 1 / np.maximum(away, 0.5 * np.median(away) + 1e-12)
    return target_from_source


def similarity(source: Floats, target: Floats, weights: Floats) -> Floats:
    """3x3 similarity by weighted least squares, without reflection. With points as complex numbers it is the linear
    regression target = a * source + b."""
    weights = weights / weights.sum()
    z, w = source @ [1, 1j], target @ [1, 1j]
    z_mean, w_mean = weights @ z, weights @ w
    a = (weights @ (np.conj(z - z_mean) * (w - w_mean))) / (weights @ np.abs(z - z_mean) ** 2)
    b = w_mean - a * z_mean
    return np.array([[a.real, -a.imag, b.real], [a.imag, a.real, b.imag], [0, 0, 1]])


def lengths(vectors: Floats) -> Floats:
    return np.asarray(np.hypot(vectors[:, 0], vectors[:, 1]))
