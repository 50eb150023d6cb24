"""Lines over a patch: nothing of it is left out, nothing far beside it is flown, and no way is longer than it must be."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.handover.lawnmower import Sweep, in_order, sweep_over

SIZE, SPACING, BEYOND = 1.0, 12.0, 5.0


def rectangle(width: int, height: int, turn: float = 0.0) -> np.ndarray:
    """Cells of a turned rectangle."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(np.stack([x.ravel(), y.ravel()], axis=-1).astype(float) @ np.array([[c, s], [-s, c]]))


def distances(points: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Of each point (n,) from the nearest line."""
    found = np.full(len(points), np.inf)
    for a, b in lines:
        share = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
        found = np.minimum(found, np.hypot(*(points - a - share[:, None] * (b - a)).T))
    return found


@given(
    width=st.integers(1, 80),
    height=st.integers(1, 80),
    turn=st.floats(0, math.pi),
    holes=st.lists(st.tuples(st.integers(0, 70), st.integers(0, 70), st.integers(1, 30)), max_size=3),
)
def test_each_cell_lies_within_half_the_spacing_of_a_line(
    width: int, height: int, turn: float, holes: list[tuple[int, int, int]]
) -> None:
    cells, flat = rectangle(width, height, turn), rectangle(width, height)
    for x, y, side in holes:
        keep = (np.abs(flat - (x, y)) > side).any(axis=1)
        if keep.any():
            cells, flat = cells[keep], flat[keep]
    lines = sweep_over(cells, SIZE, SPACING, BEYOND).lines
    assert distances(cells, lines).max() <= (SPACING + SIZE) / 2 + 1e-6


def test_lines_go_along_the_longer_side_there_and_back_and_beyond_it() -> None:
    lines = sweep_over(rectangle(100, 30), SIZE, SPACING, BEYOND).lines
    assert len(lines) == 3  # 30 m at 12 m
    directions = lines[:, 1] - lines[:, 0]
    assert np.abs(directions[:, 1]).max() < 1e-4
    assert np.sign(directions[:, 0]).tolist() in ([1, -1, 1], [-1, 1, -1])
    assert np.abs(directions[:, 0]) == pytest.approx([99 + 2 * BEYOND] * 3, abs=1e-4)


def test_what_lies_between_the_ends_of_a_bent_patch_is_not_flown() -> None:
    flat = rectangle(100, 60)
    bent = flat[(flat[:, 1] < 10) | (flat[:, 0] < 10) | (flat[:, 0] > 89)]  # a U
    lines = sweep_over(bent, SIZE, SPACING, 0.0).lines
    assert np.hypot(*(lines[:, 1] - lines[:, 0]).T).sum() < 330  # its arms and its bottom; all of it would be 500 m
    assert distances(bent, lines).max() <= (SPACING + SIZE) / 2 + 1e-6


def at(x: float) -> Sweep:
    return Sweep(np.array([[[x, 0.0], [x + 10, 0.0]], [[x + 10, 5.0], [x, 5.0]]]))


def test_the_nearest_patch_comes_next_from_its_nearest_end() -> None:
    start = np.array([0.0, -50.0])
    ordered = in_order([at(100), at(0), at(50)], start)
    assert [index for index, _ in ordered] == [1, 2, 0]
    for (_, one), (_, following) in itertools.pairwise(ordered):
        ends = [way.lines[0, 0] for way in following.variants()]
        away = [float(np.hypot(*(end - one.lines[-1, 1]))) for end in ends]
        assert float(np.hypot(*(following.lines[0, 0] - one.lines[-1, 1]))) == min(away)


def test_a_patch_of_one_cell_is_a_line() -> None:
    (line,) = sweep_over(np.array([[3.0, 4.0]]), SIZE, SPACING, BEYOND).lines
    assert line.mean(axis=0) == pytest.approx([3.0, 4.0])
    assert float(np.hypot(*(line[1] - line[0]))) == pytest.approx(2 * BEYOND)
