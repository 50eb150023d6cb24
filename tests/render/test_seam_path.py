"""A seam between two pictures runs where they differ least, and as it was where nothing tells otherwise."""

import numpy as np
import pytest

from gcs_mosaic.render.cells import CELLS, NOBODY, OPEN, WHOLLY, Cells
from gcs_mosaic.render.seam_path import BAND, STEPS, least_seen

SIDE = 3 * CELLS
GROUND = np.full((3, SIDE, SIDE), 90, np.uint8)
# Above 0 frame 1 shows, below it frame 2: the seam in the middle, all of it open.
ACROSS = np.linspace(1, -1, SIDE, dtype=np.float32)[None, :].repeat(SIDE, axis=0)
MIDDLE = SIDE // 2


def cells(decided: np.ndarray) -> Cells:
    first = np.where(decided > 0, 1, 2).astype(np.int32)
    inside = np.full((2, *decided.shape), WHOLLY, np.uint8)
    nothing = np.zeros((0, *decided.shape), np.uint8)
    return Cells(first, 3 - first, np.abs(decided).astype(np.float32), np.zeros_like(decided), inside, nothing)


def shown(decided: np.ndarray, thing: np.ndarray) -> np.ndarray:
    """The frame that shows at each cell; `thing` is seen by frame 1 alone."""
    known = cells(decided)
    looks = np.where(known.first == 1, thing, GROUND), np.where(known.first == 1, GROUND, thing)
    return least_seen(known, looks).first


def with_thing(left: int, right: int) -> np.ndarray:
    """Ground on which a thing stands that the other picture has not."""
    picture = GROUND.copy()
    picture[:, MIDDLE - 4 : MIDDLE + 4, left:right] = 200
    return picture


def test_where_the_pictures_agree_the_seam_stays() -> None:
    assert np.array_equal(shown(ACROSS, GROUND), np.where(ACROSS > 0, 1, 2))


@pytest.mark.parametrize(("left", "right", "whole"), [(MIDDLE - 6, MIDDLE + 2, 1), (MIDDLE - 2, MIDDLE + 6, 2)])
def test_a_thing_under_the_seam_is_taken_whole_or_not_at_all(left: int, right: int, whole: int) -> None:
    on_thing = shown(ACROSS, with_thing(left, right))[MIDDLE - 3 : MIDDLE + 3, left + 1 : right - 1]
    assert (on_thing == whole).all()


def test_what_is_decided_stays() -> None:
    decided = np.where(ACROSS > 0, OPEN, -OPEN).astype(np.float32)
    assert np.array_equal(shown(decided, with_thing(0, SIDE)), np.where(ACROSS > 0, 1, 2))


def test_a_frame_that_covers_only_a_part_of_a_cell_is_not_taken() -> None:
    known = cells(ACROSS)
    known.inside[1] = 1
    looks = with_thing(MIDDLE - 2, MIDDLE + 6), GROUND
    assert np.array_equal(least_seen(known, looks).first, known.first)


def test_the_course_is_the_same_however_much_of_the_map_it_is_told_for() -> None:
    rng = np.random.default_rng(1)
    noise = (90 + 40 * rng.random((3, SIDE, SIDE))).astype(np.uint8)
    decided = (ACROSS + 0.3 * rng.standard_normal(ACROSS.shape)).astype(np.float32)
    known, looks = cells(decided), (noise, GROUND)
    whole, cut = least_seen(known, looks), np.s_[..., 5:, 7:]
    part = Cells(*(array[cut] for array in known.arrays))
    again = least_seen(part, (noise[cut], GROUND[cut]))
    inner = BAND + STEPS + 1
    for here, there in zip(whole.arrays, again.arrays, strict=True):
        np.testing.assert_array_equal(here[5 + inner :, 7 + inner :], there[inner:, inner:])
    assert not np.array_equal(whole.first, known.first)


def test_three_frames_meet() -> None:
    """Each cell has two of them to choose from; its neighbours speak for what they may show themselves."""
    known = cells(ACROSS)
    known.first[:MIDDLE] = 3
    known.second[:MIDDLE] = np.where(ACROSS[:MIDDLE] > 0, 1, 2)
    owned = least_seen(known, (with_thing(MIDDLE - 6, MIDDLE + 2), GROUND))
    assert set(np.unique(owned.first)) == {1, 2, 3}
    assert ((owned.first == known.first) | (owned.first == known.second)).all()
    assert (owned.second == NOBODY).all()


def test_cells_that_hold_together_do_not_change_places_for_ever() -> None:
    """A thing that frame 1 alone has, on cells each of which was decided by a hair, one so and the next otherwise."""
    row, column = np.indices((SIDE, SIDE))
    decided = np.where(abs(column - MIDDLE) <= 1, np.where((row + column) % 2, 0.1, -0.1), ACROSS).astype(np.float32)
    on_thing = shown(decided, with_thing(MIDDLE - 1, MIDDLE + 2))[MIDDLE - 3 : MIDDLE + 3, MIDDLE - 1 : MIDDLE + 2]
    assert len(np.unique(on_thing)) == 1
