"""What is warm in some looks at one place stands out more than what is warm in one, and chance does not."""

import numpy as np
import pytest

from gcs_mosaic.integral.hot_places import ANY_SIZE, HotPlace, oddities, over_heights, peaks, person_size, warmth
from gcs_mosaic.integral.stack import GroundWindow, LookStack

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
    ("cell_m", "halvings"), [(0.2, (0,)), (0.1, (1,)), (0.05, (2,)), (0.001, (4,)), (None, ANY_SIZE)]
)
def test_pixels_are_halved_until_a_person_is_some_of_them_long(cell_m: float | None, halvings: tuple[int, ...]) -> None:
    assert person_size(cell_m) == halvings


def test_a_person_of_many_pixels_is_found_when_these_are_halved() -> None:
    stack = stack_of(12, seed=3)
    put(stack, [1, 4, 8], 30, 30, 1.0, size=24)
    fine, coarse = (warmth(stack, (halvings,)) for halvings in (0, 2))
    assert coarse[36:48, 36:48].max() > fine.max()


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
