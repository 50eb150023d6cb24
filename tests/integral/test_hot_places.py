"""What is warm in some looks at one place stands out more than what is warm in one, and chance does not."""

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.ground_lens import GroundLens
from gcs_mosaic.integral.heat_palette import is_brighter_where_warmer
from gcs_mosaic.integral.hot_places import (
    ANY_SIZE,
    HotPlace,
    found_in,
    oddities,
    over_heights,
    peaks,
    person_size,
    warmth,
)
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack
from gcs_mosaic.stitch.camera.geometry import Camera, Pose

SIDE = 96
WINDOW = GroundWindow(0.0, 0.0, float(SIDE), SIDE)


def stack_of(looks: int, seed: int = 1) -> LookStack:
    noise = np.random.default_rng(seed).standard_normal((looks, SIDE, SIDE, 1)).astype(np.float32)
    return LookStack([str(one) for one in range(looks)], noise)


def put(stack: LookStack, looks: list[int], row: int, column: int, warm: float, size: int = 4) -> None:
    stack.values[looks, row : row + size, column : column + size] += warm


def test_who_is_seen_by_some_looks_stands_out_most() -> None:
    stack = stack_of(20)
    put(stack, [2, 7, 11, 16], 40, 60, 3.0)
    for look in range(20):  # a warm crown lies elsewhere in each look
        put(stack, [look], 10, 4 * look, 6.0)
    (first, *_) = peaks(oddities(stack), WINDOW, 0.0, 5)
    assert (first.x, first.y) == pytest.approx((62 - SIDE / 2, 42 - SIDE / 2), abs=2)


def test_the_mean_alone_would_miss_who_three_looks_see() -> None:
    """Of thirty looks: a tenth of his warmth is left in the mean."""
    stack = stack_of(30, seed=2)
    put(stack, [3, 9, 21], 50, 50, 4.0)
    told = warmth(stack, (0,))
    assert told[50:54, 50:54].max() > 1.5 * np.delete(told, np.s_[40:64], axis=0).max()


def test_what_nobody_or_one_look_saw_is_nothing() -> None:
    stack = stack_of(5)
    stack.values[:, :30] = np.nan
    stack.values[0, 20:30] = 50.0
    assert (warmth(stack)[:30] == 0).all()


@pytest.mark.parametrize(
    ("cell_m", "halvings"),
    [(0.2, (0,)), (0.1, (0,)), (0.05, (0, 1)), (0.037, (1, 2)), (0.001, (3, 4)), (None, ANY_SIZE)],
)
def test_pixels_are_halved_until_a_body_is_three_of_them_wide_and_once_less_for_pieces_of_it(
    cell_m: float | None, halvings: tuple[int, ...]
) -> None:
    assert person_size(cell_m) == halvings


def test_a_person_of_many_pixels_is_found_when_these_are_halved() -> None:
    stack = stack_of(12, seed=3)
    put(stack, [1, 4, 8], 30, 30, 1.0, size=24)
    fine, coarse = (warmth(stack, (halvings,)) for halvings in (0, 2))
    assert coarse[36:48, 36:48].max() > fine.max()


class Still(GroundLens):
    """A lens of which every focus shows the same looks."""

    def aperture(self, height: float, opened: float = 1.0) -> SyntheticAperture:
        return SyntheticAperture(looks=12, spread_deg=30.0, width=50.0, height=100.0)

    def stack(self, height: float, opened: float = 1.0) -> LookStack:
        return LookStack([one.name for one in self.looks], np.stack([one.image for one in self.looks]))


def lens_of(stack: LookStack, *, heat: bool = False) -> GroundLens:
    pose, camera = Pose(0.0, 0.0, 0.0), Camera(SIDE, SIDE)
    looks = [
        GroundLook(name, pose, camera, one, heat=heat) for name, one in zip(stack.names, stack.values, strict=True)
    ]
    return Still(0, WINDOW, looks, [], 0)


@pytest.mark.parametrize("is_dark", [False, True])
def test_of_pictures_that_are_dark_where_it_is_warm_the_darker_is_sought(is_dark: bool) -> None:
    stack = stack_of(12, seed=4)
    put(stack, [1, 4, 8], 20, 20, -6.0)
    put(stack, [2, 5, 9], 70, 70, 6.0)
    (first, *_) = found_in(lens_of(stack), 0.0, 1.0, 3, is_dark=is_dark)
    wanted = 22 if is_dark else 72
    assert (first.x, first.y) == pytest.approx((wanted - SIDE / 2,) * 2, abs=3)


def test_of_a_palette_brightness_tells_what_is_warm() -> None:
    """By colours the one odd thing that is darker would be as good a hint."""
    grey = stack_of(12, seed=5).values * 8 + 100
    put(LookStack([], grey), [1, 4, 8], 20, 20, -90.0)
    put(LookStack([], grey), [2, 5, 9], 70, 70, 90.0)
    coloured = [cv2.applyColorMap(one.clip(0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO) for one in grey]
    stack = LookStack([str(one) for one in range(12)], np.stack(coloured).astype(np.float32))
    (warm, *_) = found_in(lens_of(stack, heat=True), 0.0, 1.0, 3)
    assert (warm.x, warm.y) == pytest.approx((72 - SIDE / 2,) * 2, abs=3)


MONOTONE = [cv2.COLORMAP_INFERNO, cv2.COLORMAP_MAGMA, cv2.COLORMAP_PLASMA, cv2.COLORMAP_HOT]
WRAPPED = [cv2.COLORMAP_JET, cv2.COLORMAP_TURBO, cv2.COLORMAP_RAINBOW, cv2.COLORMAP_HSV]


@pytest.mark.parametrize(("palette", "rises"), [*((one, True) for one in MONOTONE), *((one, False) for one in WRAPPED)])
def test_which_palettes_are_brighter_where_it_is_warmer(palette: int, rises: bool) -> None:
    """Over all of it, as automatic gain spreads each frame."""
    ground = cv2.GaussianBlur(np.random.default_rng(6).standard_normal((256, 256)).astype(np.float32), (0, 0), 4)
    grey = np.clip(128 + ground * 1200, 0, 255).astype(np.uint8)
    told = cv2.imdecode(cv2.imencode(".jpg", cv2.applyColorMap(grey, palette))[1], cv2.IMREAD_COLOR)
    assert is_brighter_where_warmer(np.asarray(told, np.uint8)) == rises


def test_grey_and_ground_of_one_hue_are_no_palette() -> None:
    grey = np.random.default_rng(7).integers(0, 255, (64, 64, 1), np.uint8)
    assert not is_brighter_where_warmer(grey)
    assert not is_brighter_where_warmer((grey * np.array([0.4, 0.8, 0.6])).astype(np.uint8))


def test_a_body_of_which_gaps_show_pieces_is_found_by_pixels_finer_than_it() -> None:
    """Twelve pixels wide, of which each look shows another piece of four: in pixels of its width nothing is left of it."""
    stack = stack_of(20, seed=8)
    for look, (row, column) in {1: (40, 44), 5: (44, 40), 9: (48, 44), 13: (44, 44), 17: (40, 44)}.items():
        put(stack, [look], row, column, 5.0)
    told = {size: warmth(stack, (size,)) for size in (1, 3)}
    apart = {
        size: float(one[38:54, 38:54].max() - np.delete(one, np.s_[32:60], axis=0).max()) for size, one in told.items()
    }
    assert apart[1] > 1 > apart[3]


def test_one_thing_in_several_focuses_is_one() -> None:
    stack = stack_of(6)
    put(stack, [0, 2, 4], 20, 20, 9.0)
    several = [one for height in (0.0, 0.01) for one in peaks(oddities(stack), WINDOW, height, 1)]
    assert len(over_heights(several, 10.0, 0.0)) == 1


def test_a_thing_out_of_focus_lies_aside_and_is_still_one() -> None:
    """Looks from one side: over a tenth of the flying height a thing moves by a tenth of how far aside they are."""
    there, aside, another = (
        HotPlace(x=x, y=0.0, height=height, score=score)
        for x, height, score in ((0.0, -0.1, 9.0), (28.0, 0.0, 7.0), (28.0, -0.1, 5.0))
    )
    assert over_heights([there, aside], 10.0, 200.0) == [there]
    assert over_heights([there, another], 10.0, 200.0) == [there, another]
