"""Sharpness of frames beside those around them."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_mosaic.views.sharpness import relative_sharpness, sharpest

SIDE = 100.0


def boxes(columns: int, rows: int) -> np.ndarray:
    """Of frames that overlap by half."""
    corners = np.array([(column * SIDE / 2, row * SIDE / 2) for row in range(rows) for column in range(columns)])
    return np.hstack([corners, corners + SIDE])


def test_a_blurred_frame_stands_out_and_others_do_not() -> None:
    rng = np.random.default_rng(1)
    measured = 0.3 + 0.01 * rng.random(64)
    measured[27] = 0.15
    found = relative_sharpness(np.zeros(64, int), boxes(8, 8), measured.tolist())
    assert found[27] == pytest.approx(0.5, abs=0.03)
    assert np.delete(found, 27).min() > 0.95
    assert found.max() <= 1


def test_meadows_do_not_make_roads_blurred() -> None:
    """Finer ground on one half: only frames beside the border are compared with the other kind."""
    measured = np.where(np.arange(256) % 16 < 8, 0.4, 0.2)
    found = relative_sharpness(np.zeros(256, int), boxes(16, 16), measured.tolist()).reshape(16, 16)
    assert (found[:, :8] > 0.99).all()
    assert (found[:, 14:] > 0.99).all()


def test_nothing_is_told_of_few_frames_or_where_it_was_not_measured() -> None:
    islands, where = np.array([0, 0, 0, 1, 1]), boxes(5, 1)
    found = relative_sharpness(islands, where, [0.2, 0.2, 0.1, 0.2, 0.2])
    assert np.isfinite(found).tolist() == [True, True, True, False, False]
    assert np.isnan(relative_sharpness(islands, where, [None, 0.2, 0.0, 0.2, None])).all()
    where[1] = np.nan  # it sees no ground
    assert np.isnan(relative_sharpness(islands, where, [0.2] * 5)).all()
    assert relative_sharpness(np.zeros(0, int), boxes(0, 0).reshape(0, 4), []).shape == (0,)


def test_looks_at_one_place_are_compared_with_each_other() -> None:
    assert sharpest([0.2, None, 0.1]).tolist() == [1.0, 1.0, 0.5]
    assert sharpest([None, None]).tolist() == [1.0, 1.0]
    assert sharpest([]).shape == (0,)
