import numpy as np
import pytest

from gcs_mosaic.render.exposure import OverlapMeans, overlap_means, pixels_of
from gcs_mosaic.render.vignetting import (
    FLAT,
    OUTWARDS,
    Vignetting,
    VignettingEstimate,
    brightening,
    log_brightness,
    radii,
)
from tests.sure import sure

WIDTH, HEIGHT = 96, 72
CURVES = (0.0, -0.35, -0.1), (0.3, -0.5, -0.1), (0.0, -0.45, 0.0)


def grid(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)


def seen(ground: np.ndarray, x: int, y: int, exposure: float, curves: Vignetting) -> np.ndarray:
    """A thumbnail of a piece of ground through a lens with this vignetting."""
    fall = np.exp(radii(grid().reshape(-1, 2), WIDTH, HEIGHT) @ np.array(curves).T).reshape(HEIGHT, WIDTH, 3)
    return np.asarray(np.clip(ground[y : y + HEIGHT, x : x + WIDTH] * exposure * fall, 0, 255).round(), np.uint8)


def means_of(one: np.ndarray, other: np.ndarray, by: tuple[int, int]) -> OverlapMeans:
    """Of two pictures, the second of which begins so many pixels farther to the right and below."""
    return sure(overlap_means(one, other, pixels_of(*one.shape[1::-1]) - by))


def estimate(curves: Vignetting, steps: list[tuple[int, int]]) -> VignettingEstimate:
    rng = np.random.default_rng(4)
    ground = rng.normal(110, 15, (300, 400, 3))
    found, (x, y) = VignettingEstimate(), (100, 100)
    for right, down in steps:
        one = seen(ground, x, y, rng.uniform(0.7, 1.4), curves)
        other = seen(ground, x + right, y + down, rng.uniform(0.7, 1.4), curves)
        found = found.after(means_of(one, other, (right, down)).radial)
    return found


def error(curves: Vignetting) -> float:
    """The greatest error in log brightness from the middle to the corners, in any band."""
    return float(np.abs(np.subtract(curves, CURVES) @ OUTWARDS.T).max())


def test_the_curves_are_found_whatever_the_exposures() -> None:
    assert error(estimate(CURVES, [(40, 0), (0, 35), (30, 20), (-35, 10), (15, -30)]).curves) < 0.02


def test_no_vignetting_is_found_where_there_is_none() -> None:
    assert np.abs(estimate(((0, 0, 0),) * 3, [(40, 0), (0, 35), (30, 20)]).curves).max() < 0.05


def test_nothing_is_claimed_where_overlaps_tell_nothing() -> None:
    assert VignettingEstimate().curves == FLAT
    assert np.abs(estimate(CURVES, [(0, 0)] * 5).curves).max() < 0.01


def test_things_that_moved_change_nothing() -> None:
    ground = np.full((200, 300, 3), 110.0)
    one, other = seen(ground, 0, 0, 1.0, CURVES), seen(ground, 30, 20, 1.0, CURVES)
    known = VignettingEstimate().after(means_of(one, other, (30, 20)).radial)
    one[20:40, 50:60] = 240
    found = VignettingEstimate().after(means_of(one, other, (30, 20)).radial)
    assert np.abs(np.subtract(found.curves, known.curves) @ OUTWARDS.T).max() < 0.02


def test_means_without_vignetting_tell_the_exposures() -> None:
    ground = np.full((200, 300, 3), 110.0)
    one, other = seen(ground, 0, 0, 1.5, CURVES), seen(ground, 60, 40, 1.0, CURVES)
    means = means_of(one, other, (60, 40))
    flat = means.flattened(CURVES, CURVES)
    assert np.array(flat.mean_i) / flat.mean_j == pytest.approx([1.5] * 3, rel=0.01)
    assert means.flattened(FLAT, FLAT) == means


def test_what_is_taken_out_was_there() -> None:
    picture = seen(np.full((200, 300, 3), 110.0), 0, 0, 1.0, CURVES)
    factor = brightening(CURVES, grid().astype(np.float32), WIDTH, HEIGHT)
    brightest = (picture * factor)[HEIGHT // 2, WIDTH // 2]
    np.testing.assert_allclose(picture * factor, np.broadcast_to(brightest, picture.shape), atol=1.5)
    assert factor.min() < 1 < factor.max()


def test_nowhere_is_not_brightened() -> None:
    assert (brightening(CURVES, np.full((1, 1, 2), np.nan, np.float32), WIDTH, HEIGHT) == 1).all()


def test_frames_keep_their_colours_and_their_brightness() -> None:
    uneven = ((0.3, -0.61, 0.43), (0.1, -0.07, -0.01), (0.0, -0.3, 0.0))  # each band is brightest elsewhere
    pixels = np.stack(np.meshgrid(np.arange(400), np.arange(300)), axis=-1).reshape(-1, 2).astype(np.float64)
    np.testing.assert_allclose(log_brightness(uneven, radii(pixels, 400, 300)).mean(axis=0), 0, atol=1e-3)
