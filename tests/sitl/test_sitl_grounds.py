"""The adversarial grounds: what repeats does repeat, and nothing else gives a place away by accident."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sitl.ground.copies import one_hall
from sitl.ground.pattern import CELL_PX, Pattern, car_park, crop_rows, paint_pattern
from sitl.world import BARE, GROUNDS, make_world

SIZE, GSD = 512, 0.1


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_same_seed_paints_the_same_ground_and_another_another(ground: str) -> None:
    first, again, other = (make_world.__wrapped__(seed, SIZE, ground=ground).levels[0] for seed in (1, 1, 2))
    assert first.shape == (SIZE, SIZE, 3)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_bare_grounds_are_flat_but_for_hills() -> None:
    assert make_world.__wrapped__(1, SIZE, ground="water").heights.max() < 6


@pytest.mark.parametrize("pattern", [crop_rows(), car_park()])
def test_one_cell_of_a_pattern_is_found_all_over_the_ground(pattern: Pattern) -> None:
    """Turned back by the lattice's angle, the ground agrees with itself one cell further on."""
    ground = paint_pattern(pattern, 1, SIZE, GSD)[..., 1]
    turn = np.degrees(np.random.default_rng([1, 6]).uniform(0.15, 0.5))
    middle = (SIZE - 1) / 2, (SIZE - 1) / 2
    level = cv2.warpAffine(ground, cv2.getRotationMatrix2D(middle, turn, 1), (SIZE, SIZE))[128:384, 128:384]
    along, across = (round(side / GSD) for side in pattern.pitch)
    likeness = {
        shift: float(np.corrcoef(level[: -shift[0] or None, : -shift[1] or None].ravel(), moved.ravel())[0, 1])
        for shift in ((0, along), (across, 0), (across // 2, along // 2))
        if (moved := level[shift[0] :, shift[1] :]).size
    }
    assert likeness[0, along] > likeness[across // 2, along // 2] + 0.2
    assert likeness[across, 0] > likeness[across // 2, along // 2] + 0.2


def test_a_cell_has_its_proportions() -> None:
    for pattern in (crop_rows(), car_park()):
        height, width = pattern.empty.shape[:2]
        assert max(height, width) == CELL_PX
        assert height / width == pytest.approx(pattern.pitch[1] / pattern.pitch[0], rel=0.05)


def test_the_same_hall_stands_on_every_land() -> None:
    hall = one_hall(GSD)
    for seed in (1, 2):
        found = cv2.matchTemplate(BARE["halls"](seed, 1024, GSD), hall, cv2.TM_CCOEFF_NORMED)
        assert (found > 0.999).sum() == 1


def test_snow_is_almost_white_and_faint_but_for_what_lies_on_it() -> None:
    snow = BARE["snow"](1, 1024, GSD).mean(axis=-1)
    assert np.median(snow) > 225
    assert np.diff(np.quantile(snow, [0.05, 0.95]))[0] < 25
    assert 0.0005 < (snow < 150).mean() < 0.02
