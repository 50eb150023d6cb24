"""In which range counts are shown: what most frames have is seen, what few have is not clipped."""

import numpy as np
import pytest

from gcs_mosaic.render.counts_range import fitted_range, sketch_of
from gcs_mosaic.render.display import Display, camera_display

COLD, TARMAC = 27_800, 31_000


def seen(base: float, deviation: float = 60.0, seed: int = 0, hot: float = 0.0) -> np.ndarray:
    """A frame (80, 100, 1) of counts, of which a share is burning."""
    counts = np.random.default_rng(seed).normal(base, deviation, (80, 100, 1))
    counts[: round(80 * hot)] += 10_000
    return np.clip(np.rint(counts), 0, 65_535).astype(np.uint16)


def shown(display: Display, image: np.ndarray) -> np.ndarray:
    return display.picture(image)[..., 0]


@pytest.mark.parametrize("hot", [0, 1, 4, 9])
@pytest.mark.parametrize("base", [COLD, 7400])
def test_both_tarmac_and_cold_ground_are_seen_wherever_they_come(hot: int, base: int) -> None:
    frames = [seen(base + (3200 if number < hot else 0), seed=number) for number in range(10)]
    display = camera_display([sketch_of(one) for one in frames])
    levels = [shown(display, one) for one in frames]
    most = levels[-1] if hot < 5 else levels[0]
    assert most.std() > 14
    assert all(((one == 0) | (one == 255)).mean() < 0.01 for one in levels)
    assert display == camera_display([sketch_of(one) for one in frames[::-1]])  # whatever their order


def test_a_fire_takes_little_of_the_range() -> None:
    frames = [seen(COLD, seed=number, hot=0.1 if number == 0 else 0) for number in range(6)]
    display = camera_display([sketch_of(one) for one in frames])
    assert shown(display, frames[1]).std() > 25
    assert shown(display, frames[0])[:8].min() > shown(display, frames[0])[8:].max()


def test_levels_rise_with_the_counts() -> None:
    frames = [seen(base, seed=base) for base in (20_000, COLD, TARMAC)]
    display = camera_display([sketch_of(one) for one in frames])
    every = np.arange(65_536, dtype=np.uint16)[:, None, None]
    assert (np.diff(display.levels(every)[:, 0, 0].astype(float)) > 0).all()
    assert (np.diff(display.picture(every)[:, 0, 0].astype(int)) >= 0).all()


def test_dead_lines_do_not_make_a_thermal_camera_one_whose_counts_begin_at_zero() -> None:
    frames = [seen(COLD, seed=number) for number in range(3)]
    for one in frames:
        one[:2] = 0
    (black,), _, _ = fitted_range([sketch_of(one) for one in frames], 1)
    assert shown(camera_display([sketch_of(one) for one in frames]), frames[0])[2:].std() > 20
    assert abs(black - COLD) < 1000


def test_counts_near_zero_keep_their_black_and_most_frames_are_not_clipped() -> None:
    frames = [seen(3000, 900, seed=number, hot=1.0 if number == 0 else 0) for number in range(20)]
    (black,), (white,), knots = fitted_range([sketch_of(one) for one in frames], 1)
    assert (black, knots) == (0, ())
    assert 5000 < white < 8000


def test_the_range_ends_where_counts_end() -> None:
    assert fitted_range([sketch_of(seen(32_000, 14_000))], 1)[1] == (65_535,)


@pytest.mark.parametrize("bands", [1, 3])
def test_a_border_without_data_decides_nothing(bands: int) -> None:
    """Of pictures that were turned or straightened: nought, or not a number, over a third of them."""
    whole = [
        np.concatenate([seen(COLD, seed=3 * number + band) for band in range(bands)], axis=2) for number in range(4)
    ]
    bordered = [one.copy() for one in whole]
    for one in bordered:
        one[:, :33] = 0
    display, usual = (camera_display([sketch_of(one) for one in frames]) for frames in (bordered, whole))
    for one in bordered:
        assert shown(display, one)[:, 33:].std() > 0.8 * shown(usual, one)[:, 33:].std() > 10
        assert not shown(display, one)[:, :33].any()
    assert sketch_of(np.zeros((20, 20, bands), np.uint16)) == ((0.0,) * 33,) * bands
