from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.render.display import PLAIN, Display, display_of


def counts(low: int, high: int, bands: int = 1, kind: type = np.uint16) -> np.ndarray:
    return np.random.default_rng(0).integers(low, high, (300, 400, bands)).astype(kind)


def test_a_picture_in_eight_bit_colour_is_shown_as_it_is() -> None:
    image = counts(0, 256, 3, np.uint8)
    assert display_of(image) == PLAIN
    assert PLAIN.picture(image) is image
    assert PLAIN.levels(image) is image


def test_grey_is_shown_as_three_equal_bands() -> None:
    grey = counts(0, 256, 1, np.uint8)
    assert (display_of(grey).picture(grey) == grey).all()


def test_what_lies_far_above_zero_is_stretched_about_its_own_range() -> None:
    """As the counts of a thermal camera: without that, all of it would be one grey."""
    image = counts(29_000, 29_400)
    shown = display_of(image).picture(image)
    assert 25 < shown.min() < 60
    assert 195 < shown.max() < 230


def test_black_stays_black_where_counts_begin_near_zero() -> None:
    display = display_of(counts(300, 4000, 5))
    assert display.black == (0,) * 5
    assert all(4000 < white < 5200 for white in display.white)


def test_a_deep_picture_in_colour_keeps_its_balance() -> None:
    image = counts(0, 1000, 3) * np.array([1, 2, 4], np.uint16)
    blue, green, red = display_of(image).picture(image).reshape(-1, 3).mean(axis=0)
    assert green / blue == pytest.approx(2, rel=0.02)
    assert red / blue == pytest.approx(4, rel=0.02)


def test_a_frame_of_one_value_has_a_stretch_too() -> None:
    flat = np.full((20, 30, 1), 7000, np.uint16)
    assert len(np.unique(display_of(flat).picture(flat))) == 1


@pytest.mark.parametrize(
    ("count", "chosen", "shown"),
    [
        (5, (), (0, 1, 2)),
        (5, (5, 3, 2), (1, 2, 4)),
        (5, (4,), (3, 3, 3)),
        (4, (5, 3, 2), (0, 1, 2)),  # it has no fifth band
        (3, (1, 2, 3), (0, 1, 2)),  # a picture in colour beside a multispectral one
        (2, (), (0, 0, 0)),
        (1, (3, 2, 1), (0, 0, 0)),
    ],
)
def test_which_bands_are_shown(count: int, chosen: tuple[int, ...], shown: tuple[int, ...]) -> None:
    assert display_of(counts(0, 99, count), chosen).shown == shown


def test_a_gain_counts_from_black() -> None:
    image = np.array([[[1200, 10], [500, 60_000]]], np.uint16)
    gained = Display((0, 0, 0), (1000, 0), (3000, 40_000)).gained(image, (2.0, 1.5))
    assert gained.tolist() == [[[1400, 15], [0, 65_535]]]


def test_levels_are_what_is_shown_before_it_is_rounded_and_clipped() -> None:
    display = Display((0, 0, 0), (1000,), (3000,))
    image = np.array([[[0], [1000], [2000], [4000]]], np.uint16)
    np.testing.assert_allclose(display.levels(image)[0, :, 0], [-127.5, 0, 127.5, 382.5])
    assert display.picture(image)[0, :, 0].tolist() == [0, 0, 128, 255]


@pytest.mark.parametrize(("low", "high", "kind"), [(0, 60, np.uint8), (0, 12, np.uint8), (0, 4000, np.uint16)])
def test_a_dark_frame_is_shown_lighter_if_asked_for(low: int, high: int, kind: type) -> None:
    dark = counts(low, high, 3, kind)
    if kind is np.uint16:
        dark[50, 50] = 60_000
        dark[100:110] = 30_000  # lamps, which set the stretch
    display, plain = display_of(dark, lighten=True), display_of(dark)
    assert 0.4 <= display.gamma <= 1 <= display.factor <= 6
    assert replace(display, factor=1.0, gamma=1.0) == plain
    picture = plain.picture(dark)
    assert (display.picture(dark) == picture).all()  # what is matched and looked at stays as it is
    shown = display.lightened(picture)
    assert (shown >= picture).all()
    assert 75 < np.median(shown) < 106  # as far as what there is of it lets it
    assert (shown == 255).mean() < (picture == 255).mean() + 0.01


def test_what_is_light_enough_stays_as_it_is() -> None:
    image = counts(60, 256, 3, np.uint8)
    assert display_of(image, lighten=True) == PLAIN
    assert PLAIN.lightened(image) is image
