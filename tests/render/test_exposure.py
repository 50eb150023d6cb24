import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.render.exposure import (
    SHOULDER,
    WHITE,
    ExposureSettings,
    OverlapMeans,
    apply_gain,
    gain_beside,
    is_false_colour,
    overlap_means,
    rolled_off,
    solve_gains,
)
from tests.sure import sure


def seen(true_i: float, true_j: float, count: int = 2000) -> OverlapMeans:
    """Ground of brightness 100 through two exposures."""
    return OverlapMeans((100 * true_i,) * 3, (100 * true_j,) * 3, count)


def test_gains_make_overlapping_frames_agree() -> None:
    exposures = np.exp(np.random.default_rng(1).normal(0, 0.3, 30))
    pairs = [(i, j, seen(exposures[i], exposures[j])) for i in range(30) for j in range(max(0, i - 3), i)]
    brightness = exposures * np.array(solve_gains(30, pairs))[:, 1]
    assert max(abs(np.log(brightness[i] / brightness[j])) for i, j, _ in pairs) < 0.01


def test_a_step_of_automatic_exposure_disappears_from_the_seam() -> None:
    exposures = [1.0] * 40 + [2.0] * 40
    pairs = [(i, i - 1, seen(exposures[i], exposures[i - 1])) for i in range(1, 80)]
    gains = np.array(solve_gains(80, pairs))[:, 0]
    assert abs(np.log(2 * gains[40] / gains[39])) < 0.02


def test_a_long_chain_does_not_drift() -> None:
    rng = np.random.default_rng(2)
    pairs = [(i, i - 1, seen(1.0, float(np.exp(0.01 + rng.normal(0, 0.01))))) for i in range(1, 1000)]
    gains = np.array(solve_gains(1000, pairs))
    assert 0.5 < gains.min() < gains.max() < 2.0


@pytest.mark.parametrize("bias", [-0.005, 0.0, 0.005])
def test_gains_that_are_told_one_by_one_do_not_drift_and_follow_steps(bias: float) -> None:
    """1,000 frames, each told from the two before it with an error, whose exposure doubles and halves every 40 frames."""
    rng = np.random.default_rng(5)
    exposures = np.exp(np.log(2) * (np.arange(1000) // 40 % 2))
    gains: list[float] = []
    for i, own in enumerate(exposures):
        errors = np.exp(rng.normal(bias, 0.01, 2))
        beside = [(seen(own * errors[i - j - 1], exposures[j]), (gains[j],) * 3) for j in (i - 1, i - 2) if j >= 0]
        gains.append(gain_beside(beside)[0])
    brightness = gains * exposures
    assert 0.5 < brightness.min() < brightness.max() < 2.2
    assert np.abs(np.diff(np.log(brightness))).mean() < 0.015


def test_frames_without_overlap_keep_their_brightness() -> None:
    assert solve_gains(3, []) == [(1.0, 1.0, 1.0)] * 3
    assert solve_gains(3, [(0, 1, seen(1, 2))])[2] == (1.0, 1.0, 1.0)
    assert gain_beside([]) == (1.0, 1.0, 1.0)


def test_channels_are_solved_on_their_own() -> None:
    blue_only = OverlapMeans((120.0, 80.0, 80.0), (60.0, 80.0, 80.0), 5000)
    (blue_i, green_i, red_i), (blue_j, *_) = solve_gains(2, [(0, 1, blue_only)])
    assert blue_i * 120 == pytest.approx(blue_j * 60, rel=0.01)
    assert (green_i, red_i) == (1.0, 1.0)


def test_a_new_frame_follows_its_painted_neighbours() -> None:
    gain = gain_beside([(seen(2.0, 1.0), (1.5, 1.5, 1.5)), (seen(2.0, 3.0), (0.5, 0.5, 0.5))])
    assert gain == pytest.approx([0.75] * 3, rel=0.01)


@given(st.floats(1e-3, 1e3))
def test_gains_stay_within_their_bounds(ratio: float) -> None:
    settings = ExposureSettings()
    for gain in solve_gains(2, [(0, 1, seen(1.0, ratio))]):
        assert settings.least_gain <= min(gain) <= max(gain) <= settings.most_gain


def test_means_are_those_of_the_common_ground() -> None:
    ground = np.random.default_rng(3).integers(40, 200, (80, 180, 3), dtype=np.uint8)
    means = sure(overlap_means(ground[:, :100], ground[:, 60:160] // 2, lambda pixels: pixels - [60, 0]))
    assert means.count == 40 * 80
    assert means.mean_i == pytest.approx(ground[:, 60:100].reshape(-1, 3).mean(axis=0), abs=1)
    assert means.mean_j == pytest.approx(np.array(means.mean_i) / 2, abs=0.6)


def test_clipped_pixels_do_not_count_and_no_overlap_is_none() -> None:
    grey = np.full((50, 60, 3), 100, np.uint8)
    burnt = grey.copy()
    burnt[:25] = 255
    assert sure(overlap_means(grey, burnt, lambda pixels: pixels)).mean_j == (100.0,) * 3
    assert overlap_means(grey, np.full_like(grey, 255), lambda pixels: pixels) is None
    assert overlap_means(grey, grey, lambda pixels: pixels + 1000) is None
    assert overlap_means(grey, grey, lambda pixels: pixels * np.nan) is None


def test_a_gain_multiplies_and_rolls_off_what_it_would_blow() -> None:
    image = np.full((2, 2, 3), 100, np.uint8)
    assert apply_gain(image, (1.0, 1.0, 1.0)) is image
    assert apply_gain(image, (0.5, 1.5, 4.0))[0, 0].tolist() == [50, 150, 242]


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.05, 1.4, 4.0])
def test_no_light_is_blown_that_the_photograph_has(factor: float) -> None:
    taken = np.arange(256, dtype=np.float32)
    shown = rolled_off(taken * np.float32(factor), np.full(256, factor, np.float32))
    assert (np.diff(shown) > 0).all()
    assert (shown[taken < WHITE] < WHITE).all()
    dark = taken * factor <= SHOULDER
    np.testing.assert_array_equal(shown[dark], taken[dark] * np.float32(factor))
    if factor <= 1:
        np.testing.assert_array_equal(shown, taken * np.float32(factor))
    else:
        assert shown[int(WHITE)] == pytest.approx(WHITE, abs=0.01)


@pytest.mark.parametrize("palette", ["INFERNO", "JET", "HOT", "PLASMA", "RAINBOW", "MAGMA"])
def test_palettes_are_told_from_ground(palette: str) -> None:
    grey = np.random.default_rng(4).integers(0, 256, (60, 96), dtype=np.uint8)
    assert is_false_colour(cv2.applyColorMap(grey, getattr(cv2, f"COLORMAP_{palette}")).astype(np.uint8))


@pytest.mark.parametrize("tint", [(1, 1, 1), (0.3, 0.7, 0.4), (1, 0.8, 0.3), (0.2, 0.4, 1)])
def test_ground_of_one_hue_is_no_palette(tint: tuple[float, float, float]) -> None:
    """Grey, meadows, water and red soil, from shade to glare."""
    brightness = np.random.default_rng(4).integers(20, 180, (60, 96, 1))
    assert not is_false_colour((brightness * tint).astype(np.uint8))
    assert not is_false_colour((brightness * np.ones(5)).astype(np.float32))


def test_grey_stays_grey() -> None:
    pairs = [(i, i - 1, seen(1.0 + i % 3, 1.0 + (i - 1) % 3)) for i in range(1, 9)]
    assert all(len(set(gain)) == 1 for gain in solve_gains(9, pairs))
