import numpy as np
import pytest

from gcs_mosaic.stitch.painting.exposure import overlap_means
from gcs_mosaic.stitch.painting.vignetting import (
    FLAT,
    VignettingEstimate,
    brightened,
    brightening,
    brightening_map,
    radii,
)

WIDTH, HEIGHT = 96, 72
CURVE = (-0.35, -0.1)


def grid(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)


def seen(ground: np.ndarray, x: int, y: int, exposure: float, curve: tuple[float, float]) -> np.ndarray:
    """A thumbnail of a piece of ground through a lens with this vignetting."""
    fall = np.exp(radii(grid().reshape(-1, 2), WIDTH, HEIGHT) @ curve).reshape(HEIGHT, WIDTH, 1)
    return np.clip(ground[y : y + HEIGHT, x : x + WIDTH] * exposure * fall, 0, 255).round().astype(np.uint8)


def estimate(curve: tuple[float, float], steps: list[tuple[int, int]]) -> VignettingEstimate:
    rng = np.random.default_rng(4)
    ground = rng.normal(110, 15, (300, 400, 3))
    found, (x, y) = VignettingEstimate(), (100, 100)
    for right, down in steps:
        one = seen(ground, x, y, rng.uniform(0.7, 1.4), curve)
        other = seen(ground, x + right, y + down, rng.uniform(0.7, 1.4), curve)
        means = overlap_means(one, other, lambda pixels, by=(right, down): pixels - by)
        found = found.after(means.radial)
    return found


def error(curve: tuple[float, float]) -> float:
    """The greatest error in log brightness from the middle to the corners."""
    r = np.linspace(0, 1, 21)
    return float(np.abs((curve[0] - CURVE[0]) * r**2 + (curve[1] - CURVE[1]) * r**4).max())


def test_the_curve_is_found_whatever_the_exposures() -> None:
    assert error(estimate(CURVE, [(40, 0), (0, 35), (30, 20), (-35, 10), (15, -30)]).curve) < 0.02


def test_no_vignetting_is_found_where_there_is_none() -> None:
    assert np.abs(estimate(FLAT, [(40, 0), (0, 35), (30, 20)]).curve).max() < 0.05


def test_nothing_is_claimed_where_overlaps_tell_nothing() -> None:
    assert VignettingEstimate().curve == FLAT
    assert np.abs(estimate(CURVE, [(0, 0)] * 5).curve).max() < 0.01


def test_things_that_moved_change_nothing() -> None:
    ground = np.full((200, 300, 3), 110.0)
    one, other = seen(ground, 0, 0, 1.0, CURVE), seen(ground, 30, 20, 1.0, CURVE)
    one[20:40, 50:60] = 240
    found = VignettingEstimate().after(overlap_means(one, other, lambda pixels: pixels - [30, 20]).radial)
    assert error(found.curve) < 0.05


def test_means_without_vignetting_tell_the_exposures() -> None:
    ground = np.full((200, 300, 3), 110.0)
    one, other = seen(ground, 0, 0, 1.5, CURVE), seen(ground, 60, 40, 1.0, CURVE)
    means = overlap_means(one, other, lambda pixels: pixels - [60, 40]).flattened(CURVE, CURVE)
    assert np.array(means.mean_i) / means.mean_j == pytest.approx([1.5] * 3, rel=0.01)


def test_what_is_taken_out_was_there() -> None:
    flat = np.full((200, 300, 3), 110.0)
    picture = seen(flat, 0, 0, 1.0, CURVE)
    for factor in (
        brightening(CURVE, grid().astype(np.float32), WIDTH, HEIGHT),
        brightening_map(CURVE, WIDTH, HEIGHT),
    ):
        np.testing.assert_allclose(brightened(picture, factor), 110, atol=1)


def test_nowhere_is_not_brightened() -> None:
    assert brightening(CURVE, np.full((1, 1, 2), np.nan, np.float32), WIDTH, HEIGHT) == 1
