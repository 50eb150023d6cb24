"""What the ground of a picture is like at the size of a person, and how looks at it differ."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.detection.clutter import SIDE_PX, disagreement, filtered, scores, statistics
from gcs_mosaic.detection.looks import look_at
from gcs_mosaic.detection.persons import COLOURS, POSTURES, SIZES_M, Clothes, Person, Posture
from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR

SIDE = 12.0  # px of a person
MIDDLE = np.array([[200.0, 150.0]])


def ground(deviation: float, seed: int = 1, grain: int = 12, size: tuple[int, int] = (400, 300)) -> ImageBGR:
    """Brown ground with patches of a person's size."""
    width, height = size
    noise = (
        np.random.default_rng(seed).normal(0, deviation, (height // grain + 1, width // grain + 1)).astype(np.float32)
    )
    large = cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)[..., None]
    return np.asarray(np.clip(np.array([70, 110, 130], np.float32) + large, 0, 255), np.uint8)


def with_a_person(picture: ImageBGR, bgr: tuple[int, int, int]) -> ImageBGR:
    seen = picture.copy()
    seen[144:156, 194:206] = bgr
    return seen


def mesh(shift: float, scale: float, size: tuple[int, int] = (400, 300)) -> FloatImage:
    """Where a picture's pixels lie in another that is so many pixels beside it."""
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, 8), np.linspace(0, size[1] - 1, 8))
    return ((np.stack([x + shift, y], axis=-1) + 0.5) * scale - 0.5).astype(np.float32)


@pytest.mark.parametrize("clothes", ["orange", "brown"])
@pytest.mark.parametrize("deviation", [3.0, 8.0, 16.0])
def test_a_person_stands_out_by_what_was_stated(deviation: float, clothes: Clothes) -> None:
    """The matched filter's output at a person, who lies across pixels and is taken for ground as well, is the stated contrast."""
    empty = statistics(filtered(ground(deviation), SIDE))
    person = Person(posture="standing", clothes=clothes)
    stated = look_at(empty, None, MIDDLE, person).in_sun[0] * empty.tail
    picture = filtered(with_a_person(ground(deviation), COLOURS[clothes]), SIDE)
    found = scores(picture, statistics(picture).covariances)
    row, column = round(150 * picture.scale), round(200 * picture.scale)
    assert found[row - 1 : row + 2, column - 1 : column + 2].max() == pytest.approx(stated, rel=0.1)


@pytest.mark.parametrize("posture", POSTURES)
def test_how_far_a_person_spreads_is_that_of_a_rectangle_of_its_size(posture: Posture) -> None:
    """Averaged over squares of its area, over all headings."""
    size_px, side = np.array(SIZES_M[posture]) * 40, round(40 * float(np.sqrt(np.prod(SIZES_M[posture]))))
    spread = []
    for heading in range(0, 180, 5):
        drawn = np.zeros((300, 300), np.uint8)
        cv2.fillPoly(drawn, [cv2.boxPoints(((150, 150), size_px.tolist(), heading)).astype(np.int32)], 1)
        spread.append((cv2.blur(drawn.astype(np.float32), (side, side)) ** 2).sum() / side**2)
    person = Person(posture=posture)
    assert np.mean(spread) / person.fill**2 == pytest.approx(person.spread, rel=0.1)


def test_more_clutter_and_less_contrast_make_a_person_stand_out_less() -> None:
    calm, wild = (statistics(filtered(ground(each), SIDE)) for each in (4.0, 25.0))
    orange, brown = (Person(posture="lying", clothes=each) for each in ("orange", "brown"))
    assert look_at(calm, None, MIDDLE, orange).in_sun > 2 * look_at(wild, None, MIDDLE, orange).in_sun
    assert look_at(calm, None, MIDDLE, orange).in_sun > 2 * look_at(calm, None, MIDDLE, brown).in_sun


def test_in_the_shade_bright_clothes_stand_out_less() -> None:
    picture = ground(15.0)  # on plain ground, both would stand out by as much as anybody can
    picture[:, :130] = picture[:, :130] // 4  # the shade, away from the middle
    told = statistics(filtered(picture, SIDE))
    look = look_at(told, None, np.array([[40.0, 150.0], [320.0, 150.0]]), Person(clothes="white"))
    assert look.in_shade[0] < 0.7 * look.in_sun[0]
    assert look.in_shade[1] == pytest.approx(look.in_sun[1], rel=0.1)


@pytest.mark.parametrize("shift", [0.0, 37.0])
def test_two_looks_at_open_ground_agree_wherever_they_were_taken_from(shift: float) -> None:
    wide = ground(12.0, size=(500, 300))
    one, other = (filtered(np.ascontiguousarray(wide[:, left : left + 400]), SIDE) for left in (50, 50 - round(shift)))
    told = statistics(one)
    step = round(told.step_px * one.scale)
    differs = disagreement(one, other, mesh(shift, one.scale), step)
    usual = np.sqrt(told.covariances[..., 0, 0].mean())
    assert np.nanmedian(differs) < 0.3 * usual
    wrong = disagreement(one, other, mesh(shift + 60, one.scale), step)
    assert np.nanmedian(wrong) > 0.7 * usual


def test_ground_that_the_other_look_does_not_see_is_not_known() -> None:
    one = filtered(ground(12.0), SIDE)
    differs = disagreement(one, one, mesh(300.0, one.scale), round(statistics(one).step_px * one.scale))
    assert np.isfinite(differs[:, 0]).all()
    assert np.isnan(differs[:, -1]).all()


def test_grey_pictures_are_told_from_coloured_ones() -> None:
    grey = np.repeat(ground(10.0)[..., :1], 3, axis=2)
    assert statistics(filtered(grey, SIDE)).is_grey
    assert not statistics(filtered(ground(10.0), SIDE)).is_grey


def test_a_crosshair_makes_no_colour_picture_of_a_thermal_one() -> None:
    grey = np.repeat(ground(10.0)[..., :1], 3, axis=2)
    cv2.drawMarker(grey, (150, 100), (0, 0, 255), cv2.MARKER_CROSS, 30, 2)
    assert statistics(filtered(grey, SIDE)).is_grey


def test_a_colour_picture_of_snow_with_a_few_trees_stays_one() -> None:
    snow = np.full((240, 320, 3), 230, np.uint8)
    snow[:20, :80] = (60, 90, 70)  # trees, two hundredths of it and a little
    assert not statistics(filtered(snow, SIDE)).is_grey


@pytest.mark.parametrize("side", [0.4, 2.0, 5.0, 60.0])
def test_persons_of_any_size_are_measured(side: float) -> None:
    picture = filtered(ground(10.0), side)
    assert 1 <= picture.side <= SIDE_PX
    told = statistics(picture)
    assert np.isfinite(told.colours).all()
    assert np.linalg.eigvalsh(told.covariances).min() > 0
