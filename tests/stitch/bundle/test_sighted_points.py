"""Of all tracks those are chosen that tie every pair of frames together evenly."""

import numpy as np
import pytest

from gcs_mosaic.stitch.bundle import sighted_points
from gcs_mosaic.stitch.bundle.sighted_points import (
    CELLS,
    MOST_SIGHTINGS,
    patch_shares,
    together,
    well_spread,
)

RNG = np.random.default_rng(1)


def test_entries_of_a_group_meet_each_other_and_themselves() -> None:
    one, other = together(np.array([4, 4, 7, 9, 9]))
    assert list(zip(one.tolist(), other.tolist(), strict=True)) == [
        *((0, 0), (0, 1), (1, 0), (1, 1)),
        (2, 2),
        *((3, 3), (3, 4), (4, 3), (4, 4)),
    ]
    assert not len(together(np.empty(0, np.intp))[0])


def test_in_each_cell_of_a_pair_the_point_that_is_seen_most_often_is_kept() -> None:
    # Two frames see 400 points, a third sees one in four of them.
    at = RNG.uniform(-0.5, 0.5, (400, 2))
    third = np.arange(0, 400, 4)
    row = np.concatenate([np.zeros(400), np.ones(400), np.full(100, 2)]).astype(np.intp)
    point = np.concatenate([np.arange(400), np.arange(400), third])
    seen = well_spread(row, np.concatenate([at, at, at[third]]), point)
    assert CELLS**2 <= seen.count < 3 * CELLS**2
    assert (np.bincount(seen.row) == seen.count).all(), "each has the third sighting, as every cell has such a point"
    assert seen.pairs().tolist() == [[0, 1], [0, 2], [1, 2]]


def test_a_pair_that_overlaps_by_little_is_tied_as_well() -> None:
    at = RNG.uniform(0.3, 0.5, (200, 2))
    row, point = np.repeat([0, 1], 200), np.tile(np.arange(200), 2)
    assert well_spread(row, np.tile(at, (2, 1)), point).count > 0.8 * CELLS**2


def test_a_point_that_hundreds_see_is_taken_from_an_even_dozen() -> None:
    frames = 200
    seen = well_spread(np.arange(frames), RNG.uniform(-0.5, 0.5, (frames, 2)), np.zeros(frames, np.intp))
    assert len(seen.row) == MOST_SIGHTINGS
    assert np.diff(seen.row).max() <= frames / MOST_SIGHTINGS + 1


def test_frames_that_are_looked_through_in_parts_give_the_same_points(monkeypatch: pytest.MonkeyPatch) -> None:
    row, point = (some.ravel() for some in np.indices((40, 300)))
    kept = RNG.random(len(row)) < 0.1
    pixels = RNG.uniform(-0.5, 0.5, (kept.sum(), 2))
    at_once = well_spread(row[kept], pixels, point[kept])
    monkeypatch.setattr(sighted_points, "ROWS_AT_ONCE", 7)
    in_parts = well_spread(row[kept], pixels, point[kept])
    assert np.array_equal(at_once.row, in_parts.row)
    assert np.array_equal(at_once.pixels, in_parts.pixels)
    assert np.array_equal(at_once.pairs(), in_parts.pairs())


def test_nothing_is_chosen_of_nothing() -> None:
    seen = well_spread(np.empty(0, np.intp), np.empty((0, 2)), np.empty(0, np.intp))
    assert seen.count == 0
    assert not len(seen.pairs())


def test_points_share_a_patch_of_ground() -> None:
    places = np.array([[0.1, 0.1], [0.9, 0.2], [-0.1, 0.1], [5.0, 5.0]])
    assert patch_shares(places, 1.0).tolist() == [0.5, 0.5, 1.0, 1.0]
