"""Lines that show nothing are found where the ground beside them moves, and never guessed where it does not."""

from collections.abc import Callable, Iterable
from itertools import pairwise

import cv2
import numpy as np
import pytest
from stitch_ground import Image

from gcs_mosaic.stitch.camera.dead_border import FRAMES, MARGIN, MOST_FRAMES, NO_BORDER, BorderWatch, DeadBorder

WIDTH, HEIGHT = 320, 240
GROUND = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 1, (1400, 1400, 3)), (0, 0), 6)
GROUND = np.clip(110 + 40 * GROUND / GROUND.std(), 0, 255).astype(np.uint8)
BLACK_LINES = DeadBorder(right=1, bottom=1)
WITH_MARGIN = DeadBorder(right=1 + MARGIN, bottom=1 + MARGIN)


def frame(number: int, dead: DeadBorder = NO_BORDER, level: int | None = None) -> Image:
    """What a camera sees that moves on, with a border of one grey (none: untouched) and a sensor's noise."""
    x, y = 53 * (number % 20), 41 * (number % 23)
    picture = GROUND[y : y + HEIGHT, x : x + WIDTH].astype(float)
    filled = np.full_like(picture, 10 if level is None else level)
    rows, columns = slice(dead.top, HEIGHT - dead.bottom), slice(dead.left, WIDTH - dead.right)
    filled[rows, columns] = picture[rows, columns]
    noise = np.random.default_rng(number).normal(0, 2, filled.shape)
    return np.clip(np.rint(filled + noise), 0, 255).astype(np.uint8)


def watched(frames: Iterable[Image], watch: BorderWatch | None = None) -> list[DeadBorder]:
    """The border after each frame."""
    watch, found = watch or BorderWatch(), []
    for one in frames:
        watch = watch.after(one, lambda bands: bands)
        found.append(watch.border)
    return found


def jpeg(image: Image, reduced: int = 1) -> Image:
    flag = {1: cv2.IMREAD_COLOR, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4}[reduced]
    decoded = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1], flag)
    assert decoded is not None
    return np.asarray(decoded, np.uint8)


def test_a_border_is_known_after_some_frames_and_not_before() -> None:
    found = watched(frame(k, BLACK_LINES) for k in range(12))
    assert found[: FRAMES - 1] == [NO_BORDER] * (FRAMES - 1)
    assert set(found[FRAMES - 1 :]) == {WITH_MARGIN}


@pytest.mark.parametrize("reduced", [1, 2, 4])
def test_black_lines_are_found_in_jpegs_at_every_size(reduced: int) -> None:
    """Reduced, the black line is mixed with its neighbours."""
    assert watched(jpeg(frame(k, BLACK_LINES), reduced) for k in range(8))[-1] == WITH_MARGIN


@pytest.mark.parametrize("level", [0, 16, 128, 255])
def test_bars_of_any_grey_are_found(level: int) -> None:
    bars = DeadBorder(top=24, bottom=30)
    found = watched(jpeg(frame(k, bars, level)) for k in range(10))[-1]
    assert (found.left, found.right) == (0, 0)
    assert 24 <= found.top <= 24 + MARGIN  # JPEG carries some of a white bar's neighbours into its last line
    assert 30 <= found.bottom <= 30 + MARGIN


def test_a_bar_with_figures_is_found() -> None:
    def with_figures(number: int) -> Image:
        picture = frame(number, DeadBorder(left=20), 30)
        picture[40:52, 4:16] = 10 * number
        return picture

    assert watched(with_figures(k) for k in range(8))[-1] == DeadBorder(left=21)


def test_frames_that_are_alive_all_over_have_no_dead_border() -> None:
    assert set(watched(frame(k) for k in range(30))) == {NO_BORDER}
    assert set(watched(frame(k)[:9, :7] for k in range(9))) == {NO_BORDER}


def test_a_lens_that_darkens_the_border_has_no_dead_one() -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, WIDTH), np.linspace(-1, 1, HEIGHT))
    fall = np.clip(1 - 0.45 * (x**2 + y**2), 0.03, 1)[..., None]
    assert set(watched((frame(k) * fall).astype(np.uint8) for k in range(20))) == {NO_BORDER}


def night(number: int) -> Image:
    """Black ground, a sensor's noise, a few lamps."""
    rng = np.random.default_rng(number)
    picture = np.abs(rng.normal(0, 2, (HEIGHT, WIDTH, 3)))
    for x, y in rng.integers((20, 20), (WIDTH - 20, HEIGHT - 20), (6, 2)):
        cv2.circle(picture, (int(x), int(y)), 3, (200, 220, 255), -1)
    return picture.astype(np.uint8)


def shore(number: int) -> Image:
    """Black water on the right, a quay that lies as straight as the frame and wanders as the vehicle does."""
    picture, edge = frame(number), WIDTH - 30 - [0, 7, 3, 12, 1, 9, 5, 15, 2, 4][number % 10]
    picture[:, edge:] = 4
    return picture


@pytest.mark.parametrize("seen", [night, shore, lambda number: frame(0), lambda number: np.zeros_like(frame(0))])
def test_what_is_dark_or_stands_still_is_not_dead(seen: Callable[[int], Image]) -> None:
    assert set(watched(seen(k) for k in range(30))) == {NO_BORDER}


def test_a_border_is_found_once_the_vehicle_leaves_the_ground() -> None:
    flight = [frame(0, BLACK_LINES)] * 2 + [night(k) for k in range(20)] + [frame(k, BLACK_LINES) for k in range(9)]
    found = watched(flight)
    assert set(found[:22]) == {NO_BORDER}
    assert found[-1] == WITH_MARGIN


def test_lines_that_turn_out_to_be_alive_are_given_back_for_good() -> None:
    bars = DeadBorder(left=12, bottom=1)
    frames = [frame(k, bars) for k in range(9)] + [frame(k, DeadBorder(bottom=1)) for k in range(9, 30)]
    found = watched(frames + [frame(k, bars) for k in range(30, 50)])
    assert found[8] == DeadBorder(left=13, bottom=2)
    assert found[-1] == DeadBorder(bottom=2)
    decided = found[FRAMES - 1 :]
    assert all(after.left <= before.left for before, after in pairwise(decided))


@pytest.mark.long
def test_only_the_first_frames_are_looked_at() -> None:
    looked = []

    def levels(bands: Image) -> Image:
        looked.append(bands.shape)
        return bands

    watch = BorderWatch()
    for k in range(5):
        watch = watch.after(frame(k), levels)
    assert len(looked) <= 4 * FRAMES
    seen = len(looked)
    for k in range(5, 20):
        watch = watch.after(frame(k, BLACK_LINES), levels)
    assert len(looked) == seen  # all sides have been seen to be alive
    dark = watched([night(0)] * MOST_FRAMES + [frame(k, BLACK_LINES) for k in range(9)])
    assert set(dark) == {NO_BORDER}


def test_a_watch_is_a_value() -> None:
    """Whoever keeps an earlier one can go back to it."""
    frames = [frame(k, BLACK_LINES) for k in range(9)]
    watch = BorderWatch()
    for one in frames[:3]:
        watch = watch.after(one, lambda bands: bands)
    assert watched(frames[3:], watch) == watched(frames[3:], watch)
    assert watched(frames[3:], watch)[-1] == WITH_MARGIN


def test_frames_of_counts_are_judged_as_they_are_shown() -> None:
    warm = [(frame(k, BLACK_LINES)[..., :1].astype(np.uint16) * 4 + 29_000) for k in range(9)]
    watch = BorderWatch()
    for one in warm:
        watch = watch.after(one, lambda bands: (bands.astype(np.float32) - 29_000) / 4)
    assert watch.border == WITH_MARGIN


def test_dead_pixels_take_the_nearest_living_one() -> None:
    dead = DeadBorder(2, 1, 3, 0)
    image = np.arange(7 * 9, dtype=np.uint8).reshape(7, 9, 1)
    filled = dead.filled(image)
    for y in range(7):
        for x in range(9):
            assert filled[y, x] == image[min(max(y, 1), 6), min(max(x, 2), 5)]
    assert NO_BORDER.filled(image) is image


def test_what_a_border_spares() -> None:
    dead = DeadBorder(left=2, bottom=1)
    pixels = np.array([(1.9, 50), (2, 50), (99.4, 0), (99.4, 78), (50, 78.2), (50, 79), (-0.5, 0)])
    assert dead.spares(pixels, 100, 80).tolist() == [False, True, True, True, False, False, False]
    assert dead.spares(np.array([(11.0, 10.0), (12.0, 10.0), (99, 0)]), 100, 80, reach=10.5).tolist() == [
        *(False, True, True)
    ]
    assert dead.scaled(0.5) == DeadBorder(left=1, bottom=1)
