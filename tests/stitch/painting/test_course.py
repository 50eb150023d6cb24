"""A seam between two pictures runs where they differ least, and as it was where nothing tells otherwise."""

import numpy as np
import pytest

from gcs_mosaic.stitch.painting.course import OPEN, least_seen

GROUND = np.full((256, 256, 3), 90, np.uint8)
ACROSS = np.linspace(-1, 1, 33)[None, :].repeat(33, axis=0).astype(np.float32)  # the seam in the middle, all of it open


def with_thing(left: int, right: int) -> np.ndarray:
    """Ground on which a thing stands that the other picture has not."""
    picture = GROUND.copy()
    picture[96:160, left:right] = 200
    return picture


def test_where_the_pictures_agree_the_seam_stays():
    steered = least_seen(ACROSS, GROUND, GROUND)
    assert ((steered > 0) == (ACROSS > 0))[:, [*range(15), *range(18, 33)]].all()


@pytest.mark.parametrize(("left", "right", "whole"), [(112, 176, True), (80, 144, False)])
def test_a_thing_under_the_seam_is_taken_whole_or_not_at_all(left, right, whole):
    assert len(np.unique(ACROSS[13:20, left // 8 : right // 8 + 1] > 0)) == 2
    steered = least_seen(ACROSS, with_thing(left, right), GROUND)
    on_thing = steered[13:20, left // 8 + 1 : right // 8] > 0
    assert (on_thing == whole).all()


def test_the_rim_and_what_is_decided_stay():
    decided = ACROSS * 4
    steered = least_seen(decided, with_thing(0, 256), GROUND)
    kept = np.abs(decided) >= OPEN
    kept[[0, -1]] = kept[:, [0, -1]] = True
    assert np.array_equal(steered[kept], decided[kept])
    assert not np.array_equal(steered, decided)


@pytest.mark.parametrize("side", [-1, 1])
def test_without_a_seam_there_is_nothing_to_steer(side):
    decided = np.full((33, 33), side * 0.1, np.float32)
    assert np.array_equal(least_seen(decided, with_thing(80, 144), GROUND), decided)
