from collections.abc import Sequence

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
    log_gains,
    overlap_means,
    pixels_of,
    rolled_off,
)
from gcs_mosaic.stitch.arrays import Vector
from tests.benchmarks.recorded import SHARED
from tests.sure import sure


def seen(true_i: float, true_j: float, count: int = 2000) -> OverlapMeans:
    """Ground of brightness 100 through two exposures."""
    return OverlapMeans((100 * true_i,) * 3, (100 * true_j,) * 3, count)


def shown(exposures: Sequence[float] | Vector, reach: int = 3) -> np.ndarray:
    """Log brightness of what frames show that overlap with so many before them, one channel."""
    pairs = [
        (i, j, seen(exposures[i], exposures[j])) for i in range(len(exposures)) for j in range(max(0, i - reach), i)
    ]
    return np.asarray(np.log(exposures) + log_gains(len(exposures), pairs)[:, 1])


def test_what_differs_from_frame_to_frame_goes() -> None:
    exposures = np.exp(np.random.default_rng(1).normal(0, 0.3, 60))
    assert np.abs(np.diff(shown(exposures))).mean() < 0.4 * np.abs(np.diff(np.log(exposures))).mean()


def test_exposures_that_alternate_are_evened_out() -> None:
    brightness = shown([1.0, 2.0] * 20)
    assert np.ptp(brightness[3:-3]) < ExposureSettings().unnoticed  # light fields do the rest


def test_what_lasts_stays_as_it_was_photographed() -> None:
    """A step: shade, haze, or an exposure that follows the ground. Light fields blend it over the seam."""
    exposures = [1.0] * 40 + [2.0] * 40
    np.testing.assert_allclose(shown(exposures)[[*range(37), *range(43, 80)]], np.log(exposures[:37] + exposures[43:]))
    assert (np.diff(shown(exposures)) >= 0).all()


def test_a_ramp_stays_as_it_was_photographed() -> None:
    """From black to white over 73 frames."""
    exposures = np.exp(np.linspace(-0.8, 0.8, 73))
    np.testing.assert_allclose(shown(exposures)[3:-3], np.log(exposures)[3:-3], atol=1e-9)
    np.testing.assert_allclose(shown(exposures), np.log(exposures), atol=0.01)


def test_errors_do_not_add_up_along_a_chain() -> None:
    rng = np.random.default_rng(2)
    pairs = [(i, i - 1, seen(1.0, float(np.exp(0.01 + rng.normal(0, 0.01))))) for i in range(1, 1000)]
    assert np.abs(log_gains(1000, pairs)).max() < 0.01


def test_gains_that_are_told_one_by_one_do_not_drift_and_follow_what_reverts() -> None:
    """Exposures that are halved for two frames each twenty, told from the three frames before."""
    exposures = [0.5 if i % 20 in (10, 11) else 1.0 for i in range(200)]
    gains = [gain_beside([seen(exposures[i], exposures[j]) for j in range(max(0, i - 3), i)])[0] for i in range(200)]
    assert np.log(gains[10]) > 0.6 * np.log(2)
    assert np.abs(np.log(gains[15::20])).max() < 1e-9


def test_frames_without_overlap_keep_their_brightness() -> None:
    assert not log_gains(3, []).any()
    assert not log_gains(3, [(0, 1, seen(1, 2))])[2].any()
    assert gain_beside([]) == (1.0, 1.0, 1.0)


def test_a_cast_of_one_channel_is_taken_from_it() -> None:
    def flip(order: int) -> tuple[float, float, float]:
        return (130.0, 100.0, 100.0) if order % 2 else (100.0, 100.0, 100.0)

    pairs = [(i, j, OverlapMeans(flip(i), flip(j), 5000)) for i in range(20) for j in range(max(0, i - 3), i)]
    blue, green, red = (np.log([flip(i) for i in range(20)]) + log_gains(20, pairs))[3:-3].T
    assert np.ptp(blue - green) < 0.5 * np.log(1.3)
    np.testing.assert_allclose(green, red, atol=1e-9)


def test_what_nobody_notices_is_left() -> None:
    """A fiftieth more is not worth repainting, a half more goes whole."""
    little, much = ([1.0, 1.0, 1.0, 1.0 + by, 1.0, 1.0, 1.0] for by in (0.02, 0.5))
    assert shown(little)[3] > 0.9 * np.log(1.02)
    assert shown(much)[3] < 0.3 * np.log(1.5)


@given(st.floats(1e-3, 1e3))
def test_gains_stay_within_their_bounds(ratio: float) -> None:
    settings = ExposureSettings()
    gain = gain_beside([seen(1.0, ratio)])
    assert settings.least_gain <= min(gain) <= max(gain) <= settings.most_gain


def test_means_are_those_of_the_common_ground() -> None:
    ground = np.random.default_rng(3).integers(40, 200, (80, 180, 3), dtype=np.uint8)
    means = sure(overlap_means(ground[:, :100], ground[:, 60:160] // 2, pixels_of(100, len(ground)) - [60, 0]))
    assert means.count == 40 * 80
    assert means.mean_i == pytest.approx(ground[:, 60:100].reshape(-1, 3).mean(axis=0), abs=1)
    assert means.mean_j == pytest.approx(np.array(means.mean_i) / 2, abs=0.6)


def test_clipped_pixels_do_not_count_and_no_overlap_is_none() -> None:
    grey, pixels = np.full((50, 60, 3), 100, np.uint8), pixels_of(60, 50)
    burnt = grey.copy()
    burnt[:25] = 255
    assert sure(overlap_means(grey, burnt, pixels)).mean_j == (100.0,) * 3
    assert overlap_means(grey, np.full_like(grey, 255), pixels) is None
    assert overlap_means(grey, grey, pixels + 1000) is None
    assert overlap_means(grey, grey, pixels * np.nan) is None


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


@pytest.mark.parametrize("palette", ["VIRIDIS", "INFERNO", "PLASMA", "MAGMA", "TURBO"])
@pytest.mark.parametrize("part", [(60, 130), (110, 200)], ids=["its lower half", "its upper half"])
def test_a_part_of_a_palette_is_one_too(palette: str, part: tuple[int, int]) -> None:
    """As over ground that is much alike, beside something hot or cold in the frame."""
    rng = np.random.default_rng(4)
    soft = cv2.GaussianBlur(rng.normal(size=(180, 240)), (0, 0), 4)
    grey = np.clip(np.interp(soft / soft.std(), [-2, 2], part), 0, 255).astype(np.uint8)
    picture = cv2.applyColorMap(grey, getattr(cv2, f"COLORMAP_{palette}"))
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert done
    assert is_false_colour(sure(cv2.imdecode(data, cv2.IMREAD_COLOR)).astype(np.uint8))


@pytest.mark.parametrize("flight", ["brighton", "jwcate"])
def test_colourful_ground_is_no_palette(flight: str) -> None:
    """Nor would it be with a fifth more colour."""
    folder = SHARED / flight
    if not folder.exists():
        pytest.skip("recorded flights are not beside the project")
    small = sure(cv2.imread(str(sorted(folder.glob("*.[jJ]*"))[3]), cv2.IMREAD_REDUCED_COLOR_8))
    grey = small.mean(axis=2, keepdims=True)
    for factor in (1.0, 1.2):
        assert not is_false_colour(np.clip(grey + factor * (small - grey), 0, 255).astype(np.uint8))


def test_grey_stays_grey() -> None:
    pairs = [(i, i - 1, seen(1.0 + i % 3, 1.0 + (i - 1) % 3)) for i in range(1, 9)]
    np.testing.assert_allclose(np.ptp(log_gains(9, pairs), axis=1), 0, atol=1e-12)
