"""Two maps of one flight are laid on each other, and the place in which they differ most is found."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.benchmarks.before_after import CROP, Drawn, laid_on, most_different, part_of, trimmed

SIZE = 1400, 1000
PLACES = {"a": (300.0, 200.0), "b": (1000.0, 250.0), "c": (700.0, 800.0)}


def a_map(turned: float = 0.0, moved: tuple[float, float] = (0.0, 0.0)) -> Drawn:
    """Soft ground, turned by degrees about its corner and moved."""
    soft = cv2.GaussianBlur(np.random.default_rng(3).normal(size=(*SIZE[::-1], 3)), (0, 0), 8)
    ground = np.clip(128 + 40 * soft / soft.std(), 0, 249).astype(np.uint8)
    matrix = np.asarray(cv2.getRotationMatrix2D((0, 0), turned, 1.0), np.float64)
    matrix[:, 2] += np.array(moved)
    colours = cv2.warpAffine(ground, matrix, SIZE, borderValue=(250,) * 3)
    covered = cv2.warpAffine(np.ones(SIZE[::-1], np.uint8), matrix, SIZE) > 0
    return Drawn(
        np.asarray(colours, np.uint8), np.asarray(covered), {n: matrix @ np.array([*at, 1]) for n, at in PLACES.items()}
    )


@pytest.mark.parametrize(("turned", "moved"), [(0.0, (0.0, 0.0)), (0.0, (-40.0, 25.0)), (7.0, (30.0, 60.0))])
def test_one_map_is_laid_on_the_other(turned: float, moved: tuple[float, float]) -> None:
    after = a_map()
    before = laid_on(a_map(turned, moved), after)
    assert before.covered.mean() > 0.7
    inner = cv2.erode(before.covered.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert np.abs(before.colours[inner].astype(float) - after.colours[inner]).mean() < 2


def test_the_place_that_differs_most_is_found_where_both_are_covered() -> None:
    before, after = a_map(), a_map()
    after.colours[500:860, 600:1080] //= 2
    after.covered[:, :500] = False
    after.colours[:, :500] = 250  # most of all, but no map
    left, top = most_different(before, after)
    assert abs(left - 600) < 12
    assert abs(top - 500) < 12
    assert left + CROP[0] <= SIZE[0]


def test_frames_that_are_not_shared_are_told() -> None:
    with pytest.raises(ValueError, match="share no two frames"):
        laid_on(a_map(), Drawn(a_map().colours, a_map().covered, {"x": np.zeros(2)}))


def test_what_is_empty_goes_and_frames_stay_where_they_are() -> None:
    one = a_map()
    one.covered[:100] = one.covered[:, :50] = False
    cut = trimmed(one)
    assert cut.covered.shape == (900, 1350)
    np.testing.assert_allclose(cut.centres["a"], (250, 100))


def test_a_part_is_of_names_in_order(tmp_path: Path) -> None:
    for name in ("c", "a", "b"):
        (tmp_path / name).touch()
    assert part_of(tmp_path, ":", tmp_path) == tmp_path
    assert sorted(path.name for path in part_of(tmp_path, "1:", tmp_path / "work").iterdir()) == ["b", "c"]
