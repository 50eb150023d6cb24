"""How two frames may lie at all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Matrix3x3
from gcs_mosaic.stitch.registration.a_contrario import log_evidence
from gcs_mosaic.stitch.registration.frame_pair import FramePair, independent_count
from gcs_mosaic.stitch.registration.homography import area_scale, inside, mapped, robust_homography
from gcs_mosaic.stitch.registration.parallax import LARGEST, displaced_by_height
from gcs_mosaic.stitch.registration.proposals import Proposal, is_plausible, similarities, why_impossible
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SETTINGS = RegistrationSettings()
OUTLINE = np.array([[0.0, 0.0], [400, 0], [0, 300], [400, 300], [200, 150]])


def zoomed(by: float) -> Matrix3x3:
    return np.diag([by, by, 1.0])


def slanted(ratio: float) -> Matrix3x3:
    """Right corners are magnified less than left ones by this ratio: by the power 3/2 of the depth's."""
    return np.array([[1, 0, 0], [0, 1, 0], [(ratio ** (2 / 3) - 1) / 400, 0, 1.0]])


@pytest.mark.parametrize(
    ("b_from_a", "scale", "plausible"),
    [
        (zoomed(4.99), 1.0, True),
        (zoomed(5.01), 1.0, False),
        (zoomed(1 / 4.99), 1.0, True),
        (zoomed(1 / 5.01), 1.0, False),
        (zoomed(2.0), 2.6, False),  # of pixels that are themselves so many times as large
        (zoomed(2.0), 2.4, True),
        (zoomed(0.1), 10.0, True),
        (slanted(4.4), 1.0, True),
        (slanted(4.6), 1.0, False),
        (np.diag([1.0, -1.0, 1.0]), 1.0, False),
        (np.array([[1, 0, 0], [0, 1, 0], [-1 / 300, 0, 1.0]]), 1.0, False),  # the horizon passes through the frame
        (np.array([[1, 0, 0], [0, 1, 0], [-1 / 400, 0, 1.0]]), 1.0, False),  # ... or through two corners
    ],
)
def test_no_camera_sees_the_ground_from_below_or_much_larger(
    b_from_a: Matrix3x3, scale: float, plausible: bool
) -> None:
    assert is_plausible(b_from_a, OUTLINE, scale, SETTINGS) is plausible


@pytest.mark.parametrize(
    ("homography", "evidence", "reason"),
    [
        (zoomed(1.0), 8.0, ""),
        (zoomed(1.0), 7.9, "evidence 7.9, 8.0 needed"),
        (zoomed(4.99), 9.0, ""),
        (zoomed(5.01), 9.0, "change of scale 5.01 to 5.01"),
        (zoomed(1 / 5.1), 9.0, "change of scale 0.20 to 0.20"),
        (np.diag([1.0, -1.0, 1.0]), 9.0, "the ground would be seen from below"),
        (np.diag([0.0, 1.0, 1.0]), 9.0, "the ground would be seen from below"),
    ],
)
def test_why_two_frames_cannot_lie_so(homography: Matrix3x3, evidence: float, reason: str) -> None:
    assert why_impossible(homography, OUTLINE, evidence, SETTINGS) == reason


@pytest.mark.parametrize(("evidence", "told"), [(3.0, [3.0]), (0.0, [0.0]), (-4.0, [0.0]), (-4.1, [])])
def test_what_few_matches_propose_is_worth_a_look_or_not(evidence: float, told: list[float]) -> None:
    """That few agree does not speak against a proposal."""
    assert [one.evidence for one in Proposal.of_matches(np.eye(3), evidence)] == told


def test_areas_grow_by_the_square_and_shrink_with_the_cube_of_depth() -> None:
    tilted = np.array([[1, 0, 0], [0, 1, 0], [0.001, 0, 1.0]])
    assert area_scale(zoomed(3.0), OUTLINE) == pytest.approx([9.0] * 5)
    assert area_scale(tilted, OUTLINE) == pytest.approx([1, 1.4**-3, 1, 1.4**-3, 1.2**-3])


def test_a_picture_holds_its_first_pixel_and_not_the_one_after_its_last() -> None:
    points = np.array([[0.0, 0], [-0.1, 5], [5, -0.1], [399.9, 299.9], [400, 5], [5, 300]])
    assert inside(points, np.array([400.0, 300.0])).tolist() == [True, False, False, True, False, False]


def test_no_points_are_mapped_to_none_and_no_homography_is_found_of_points_in_one_place() -> None:
    assert len(mapped(np.eye(3), np.empty((0, 2)))) == 0
    spot = np.zeros((8, 2))
    homography, inlier = robust_homography(spot, spot, 4.0)
    assert homography is None
    assert inlier.tolist() == [False] * 8


@pytest.mark.parametrize(("apart", "count"), [(15.9, 1), (16.1, 2)])
def test_matches_in_one_cell_of_either_frame_are_one(apart: float, count: int) -> None:
    points, other = np.array([[0.0, 0.0], [0.0, apart]]), np.array([[0.0, 0.0], [200.0, 90.0]])
    assert independent_count(points, other, 16) == independent_count(other, points, 16) == count
    assert independent_count(points[:0], points[:0], 16) == 0


def test_cells_of_different_rows_and_columns_are_different_ones() -> None:
    grid = np.stack(np.meshgrid(np.arange(-40, 200, 16.0), np.arange(-24, 100, 16.0)), -1).reshape(-1, 2)
    assert independent_count(grid, grid, 16) == len(grid)


def pair(a: np.ndarray, b: np.ndarray, *, scale_a: float = 1.0, scale_b: float = 1.0) -> FramePair:
    both, none = np.stack([np.arange(len(a))] * 2, axis=1), np.zeros(len(a), bool)
    size = np.array([400.0, 300.0])
    return FramePair(a, b, size, size, scale_a, scale_b, both, both, none, none)


def test_full_pixels_are_those_of_the_feature_picture_times_its_scale() -> None:
    some = pair(np.zeros((1, 2)), np.zeros((1, 2)), scale_a=2.0, scale_b=5.0)
    full = np.array([[1.0, 0.2, 30], [0.1, 1, 40], [0, 0, 1]])
    at = np.array([[12.0, 8.0]])
    assert mapped(some.reduced(full), at) == pytest.approx(mapped(full, at * 2) / 5)
    assert some.enlarged(some.reduced(full)) == pytest.approx(full)


def test_similarities_are_found_one_after_the_other() -> None:
    """Two groups of matches, which are moved each its own way; a third is too small."""
    rng = np.random.default_rng(0)
    a = rng.uniform(0, 1, (62, 2)) * [400, 300]
    b = a + np.array([30.0, 0.0])
    b[40:60], b[60:] = a[40:60] * 0.5 + [100, 60], a[60:] + np.array([0.0, 90.0])
    found = similarities(pair(a, b), SETTINGS)
    assert [np.round(one.b_from_a[:2, 2]).tolist() for one in found[:2]] == [[30, 0], [100, 60]]
    assert found[1].b_from_a[0, 0] == pytest.approx(0.5, abs=0.01)
    assert found[0].evidence > found[1].evidence > 8
    assert similarities(pair(a[:2], b[:2]), SETTINGS) == []


@pytest.mark.parametrize("count", [3, 30])
def test_unrelated_matches_propose_nothing_that_much_speaks_for(count: int) -> None:
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0, 1, (2, count, 2)) * [400, 300]
    assert max((one.evidence for one in similarities(pair(a, b), SETTINGS)), default=0.0) < 2


DIAGONAL = 1000.0


def heights(count: int, largest: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Places, and where things that stand there are seen from above the place (300, 200): displaced from it by up to that."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 1, (count, 2)) * [800, 600]
    away = places - [300.0, 200.0]
    away /= np.linalg.norm(away, axis=1)[:, None]
    return places, places + away * rng.uniform(0.3, 1, (count, 1)) * largest


def test_what_is_displaced_from_one_point_stands_above_the_ground() -> None:
    places, seen = heights(24, 30.0)
    found = displaced_by_height(places, seen, np.zeros(24, bool), DIAGONAL)
    assert found.sum() >= 22


def test_what_is_displaced_in_any_direction_does_not() -> None:
    rng = np.random.default_rng(2)
    places = rng.uniform(0, 1, (24, 2)) * [800, 600]
    angles = rng.uniform(0, 2 * math.pi, 24)
    seen = places + 30 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert not displaced_by_height(places, seen, np.zeros(24, bool), DIAGONAL).any()


def test_what_lies_on_the_plane_or_is_further_off_than_anything_stands_is_left_out() -> None:
    places, seen = heights(30, 30.0)
    on_plane = np.arange(30) < 5
    seen[5:8] = places[5:8] + (seen - places)[5:8] * 20 * LARGEST
    seen[5:8] += (seen - places)[5:8] / np.linalg.norm((seen - places)[5:8], axis=1)[:, None] * LARGEST * DIAGONAL
    found = displaced_by_height(places, seen, on_plane, DIAGONAL)
    assert not found[:8].any()
    assert found[8:].sum() >= 20


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_two_displaced_matches_meet_in_one_point_always(count: int) -> None:
    places, seen = heights(count, 30.0)
    assert not displaced_by_height(places, seen, np.zeros(count, bool), DIAGONAL).any()


def test_matches_that_have_not_moved_determine_no_point() -> None:
    places, _ = heights(12, 30.0)
    assert not displaced_by_height(places, places, np.zeros(12, bool), DIAGONAL).any()


def test_a_similarity_is_as_likely_by_chance_as_to_meet_within_eight_pixels() -> None:
    """Twice the tolerance of a homography."""
    grid = np.stack(np.meshgrid(np.arange(20.0, 380, 40), np.arange(20.0, 280, 40)), -1).reshape(-1, 2)
    (found,) = similarities(pair(grid, grid * 0.5 + [60, 40]), SETTINGS)
    close = grid * 0.5  # 20 px apart there, so that none but the own one is within eight
    assert len(close) == 63
    assert found.evidence == pytest.approx(log_evidence(63, 63, math.pi * 8**2 / (400 * 300), 2))
