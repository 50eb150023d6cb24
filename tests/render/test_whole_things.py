"""What stands up is shown by one frame: not in halves, and not twice."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_mosaic.render import seam_path
from gcs_mosaic.render.cells import CELLS, OPEN, WHOLLY, Cells
from gcs_mosaic.render.seam_path import BAND, STEPS, least_seen
from gcs_mosaic.render.whole_things import LARGEST, ROUND

SIDE = 3 * CELLS
MIDDLE = SIDE // 2
GROUND, ROOF = 90, 200
# Above 0 frame 1 shows, below it frame 2: the seam in the middle, all of it open.
ACROSS = np.linspace(1, -1, SIDE, dtype=np.float32)[None, :].repeat(SIDE, axis=0)
ROWS = slice(MIDDLE - 5, MIDDLE + 5)


def cells(decided: np.ndarray) -> Cells:
    first = np.where(decided > 0, 1, 2).astype(np.int32)
    inside = np.full((2, *decided.shape), WHOLLY, np.uint8)
    nothing = np.zeros((0, *decided.shape), np.uint8)
    return Cells(first, 3 - first, np.abs(decided).astype(np.float32), np.zeros_like(decided), inside, nothing)


def picture(left: int, right: int) -> np.ndarray:
    """A roof as one frame sees it, displaced by its height."""
    seen = np.full((3, SIDE, SIDE), GROUND, np.uint8)
    seen[:, ROWS, left:right] = ROOF
    return seen


def shown(decided: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    known = cells(decided)
    looks = np.where(known.first == 1, one, other), np.where(known.first == 1, other, one)
    return least_seen(known, looks).first


@pytest.mark.parametrize(("by", "whole"), [(-1, 1), (1, 2)])
def test_a_roof_that_is_alike_inside_is_of_one_frame(by: int, whole: int) -> None:
    """Two frames differ at its ends alone: each end went to another frame, and the roof was longer than it is."""
    one, other = (MIDDLE - 5 + by, MIDDLE + 2 + by), (MIDDLE - 2 + by, MIDDLE + 5 + by)
    found = shown(ACROSS, picture(*one), picture(*other))
    assert set(np.unique(found[ROWS, one[0] : other[1]])) == {whole}
    assert (found[:10] == np.where(ACROSS[:10] > 0, 1, 2)).all()


def test_a_roof_beside_the_seam_stays_with_its_frame() -> None:
    found = shown(ACROSS, picture(MIDDLE - 14, MIDDLE - 7), picture(MIDDLE - 11, MIDDLE - 4))
    assert set(np.unique(found[ROWS, MIDDLE - 14 : MIDDLE - 4])) == {1}


@pytest.mark.parametrize("who", [1, 2])
def test_what_one_frame_alone_has_is_not_given_up_for_a_whole(who: int) -> None:
    """A person who stands where only this frame saw them, beside the same one elsewhere in the other: both stay."""
    decided = ACROSS.copy()
    decided[ROWS, MIDDLE - 5 : MIDDLE - 1], decided[ROWS, MIDDLE + 1 : MIDDLE + 5] = 20, -20
    one, other = picture(MIDDLE - 5, MIDDLE - 1), picture(MIDDLE + 1, MIDDLE + 5)
    found = shown(decided, one, other)
    part = found[ROWS, MIDDLE - 5 : MIDDLE - 1] if who == 1 else found[ROWS, MIDDLE + 1 : MIDDLE + 5]
    assert (part == who).all()


def test_a_frame_that_is_much_better_shows_all_of_it() -> None:
    decided = np.where(np.arange(SIDE) < MIDDLE - 2, OPEN + 1, ACROSS).astype(np.float32)
    found = shown(decided, picture(MIDDLE - 5, MIDDLE + 2), picture(MIDDLE - 2, MIDDLE + 5))
    assert set(np.unique(found[ROWS, MIDDLE - 5 : MIDDLE + 5])) == {1}


def test_a_frame_that_does_not_see_all_of_it_does_not_get_it() -> None:
    known = cells(ACROSS)
    known.inside[1][:, MIDDLE + 3 :] = 1
    one, other = picture(MIDDLE - 5, MIDDLE + 2), picture(MIDDLE - 2, MIDDLE + 5)
    looks = np.where(known.first == 1, one, other), np.where(known.first == 1, other, one)
    found = least_seen(known, looks).first
    assert (found[ROWS, MIDDLE + 3 : MIDDLE + 5] == 2).all()


def test_of_ties_nothing_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """What two frames see as well would hang on the order of a sum: it stays as the seam's path has it."""
    even = np.where(np.arange(SIDE) < MIDDLE, 0.5, -0.5).astype(np.float32)[None, :].repeat(SIDE, axis=0)
    one, other = picture(MIDDLE - 5, MIDDLE + 2), picture(MIDDLE - 2, MIDDLE + 5)
    leaning = even.copy()
    leaning[MIDDLE, MIDDLE] = -0.75  # one cell decides, so the tie alone is what leaves it as it is
    assert set(np.unique(shown(leaning, one, other)[ROWS, MIDDLE - 5 : MIDDLE + 5])) == {2}
    found = shown(even, one, other)
    mirrored = shown(-even[:, ::-1], other[..., ::-1], one[..., ::-1])
    np.testing.assert_array_equal(found, 3 - mirrored[:, ::-1])
    monkeypatch.setattr(seam_path, "as_wholes", lambda _cells, _apart, taken: taken)
    np.testing.assert_array_equal(found, shown(even, one, other))


def test_it_is_the_same_however_much_of_the_map_it_is_told_for() -> None:
    """Things of all sizes, from a cell to beyond a tile."""
    rng = np.random.default_rng(3)
    one, other = np.full((2, 3, SIDE, SIDE), GROUND, np.uint8)
    for _ in range(40):
        (y, x), (high, wide) = rng.integers(0, SIDE, 2), rng.integers(1, 1 + int(rng.choice([6, 20, 45])), 2)
        (one if rng.random() < 0.5 else other)[:, y : y + high, x : x + wide] = rng.integers(0, 255)
    decided = (ACROSS + 0.3 * rng.standard_normal(ACROSS.shape)).astype(np.float32)
    known = cells(decided)
    looks = np.where(known.first == 1, one, other), np.where(known.first == 1, other, one)
    whole, cut = least_seen(known, looks), np.s_[..., 5:, 7:]
    part = Cells(*(array[cut] for array in known.arrays))
    again = least_seen(part, (looks[0][cut], looks[1][cut]))
    inner = max(BAND + STEPS, LARGEST + ROUND) + 1
    assert inner <= CELLS
    np.testing.assert_array_equal(whole.first[5 + inner :, 7 + inner :], again.first[inner:, inner:])
