"""Over hills the adjustment over points finds where cameras were, and over flat ground it changes next to nothing."""

from dataclasses import replace

import numpy as np
import pytest
from sighted_hills import CAMERA, HEIGHT, LENS, flat, hill, sighted, survey

from gcs_mosaic.stitch.arrays import Array, Mask
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.point_adjustment import FEWEST, FEWEST_FRAMES, Grounded, grounded
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.sighted_points import SightedPoints
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import similarity_between

SETTINGS = AdjustmentSettings()


def rough(poses: Array, seed: int) -> Array:
    """What an adjustment over a plane may leave: a bent map."""
    rng = np.random.default_rng([seed, 2])
    return np.asarray(poses + rng.normal(0, 1, poses.shape) * [0.02 * HEIGHT, 0.02 * HEIGHT, 0.03, 0.02, 0.04, 0.04])


def places_apart(found: Array, true: Array) -> float:
    """Root mean square distance of places (t, 2) after one similarity, pixels of the frames."""
    scale, angle, shift = similarity_between(found, true)
    c, s = np.cos(angle), np.sin(angle)
    return float(np.sqrt((((scale * found @ np.array([[c, s], [-s, c]]) + shift) - true) ** 2).sum(axis=1).mean()))


def seen_places(poses: Array, lenses: Array, seen: SightedPoints) -> Array:
    half = np.full(len(seen.row), CAMERA.half_diagonal)
    lens = np.tile(lenses[0], (len(seen.row), 1))
    return projection.canvas_from_pixels(poses[seen.row], lens, half, seen.pixels).points


def held(problem: Problem, seen: SightedPoints, start: Array) -> Grounded:
    """The frames adjusted from this start."""
    found = grounded(replace(problem, poses=start), seen, SETTINGS)
    assert found is not None, "its points hold it together"
    return found


@pytest.mark.parametrize("seed", range(3))
def test_a_hill_bends_neither_the_map_nor_the_focal_length(seed: int) -> None:
    truth = survey(seed)
    problem, seen, _ = sighted(truth, hill, seed)
    found = held(problem, seen, rough(truth, seed))
    assert abs(np.exp(found.lenses[0, 0]) / CAMERA.focal - 1) < 0.02
    assert places_apart(found.poses[:, :2], truth[:, :2]) < 0.004 * HEIGHT


@pytest.mark.parametrize("seed", range(3))
def test_what_frames_show_of_a_hill_is_drawn_where_it_is(seed: int) -> None:
    truth = survey(seed)
    problem, seen, points = sighted(truth, hill, seed)
    found, true = held(problem, seen, rough(truth, seed)), points[seen.point, :2]
    drawn = places_apart(seen_places(found.drawn, found.lenses, seen), true)
    assert drawn < 0.3 * places_apart(seen_places(truth, LENS[None], seen), true), (
        "the plane moves a hill's top outward"
    )


def test_over_flat_ground_the_map_is_as_flat() -> None:
    truth = survey(5)
    problem, seen, points = sighted(truth, flat, 5)
    found = held(problem, seen, rough(truth, 5))
    assert places_apart(seen_places(found.drawn, found.lenses, seen), points[seen.point, :2]) < 2.0
    scale = np.exp((found.drawn - found.poses)[:, 2])
    assert abs(scale - 1).max() < 0.005


@pytest.mark.parametrize("angle", [4, 5], ids=["pitch", "roll"])
def test_cameras_that_all_look_aside_do_not_tilt_flat_ground(angle: int) -> None:
    truth = survey(4, lines=1, per_line=20)
    truth[:, angle] += 0.5
    problem, seen, _ = sighted(truth, flat, 4, points=1500, around=1.6)
    found = held(problem, seen, truth)
    assert abs((found.poses - truth)[:, 4:].mean(axis=0)).max() < 0.01


def test_wrong_sightings_bend_nothing() -> None:
    truth, rng = survey(6), np.random.default_rng(6)
    problem, seen, _ = sighted(truth, hill, 6)
    lost = rng.random(len(seen.row)) < 0.05
    pixels = np.where(lost[:, None], rng.uniform(-0.6, 0.6, seen.pixels.shape), seen.pixels)
    found = held(problem, replace(seen, pixels=pixels), rough(truth, 6))
    assert abs(np.exp(found.lenses[0, 0]) / CAMERA.focal - 1) < 0.03
    assert places_apart(found.poses[:, :2], truth[:, :2]) < 0.006 * HEIGHT


def only(seen: SightedPoints, kept: Mask) -> SightedPoints:
    """Some of the sightings, of points that two frames or more still see."""
    twice = np.bincount(seen.point[kept], minlength=seen.count)[seen.point] >= 2
    kept = kept & twice
    return SightedPoints(seen.row[kept], seen.pixels[kept], np.unique(seen.point[kept], return_inverse=True)[1])


def test_an_island_stays_over_the_plane_where_a_frame_sees_too_few_points() -> None:
    problem, seen, _ = sighted(survey(7), hill, 7)
    place = np.cumsum(seen.row == 3)
    few = only(seen, (seen.row != 3) | (place < FEWEST))
    assert grounded(problem, few, SETTINGS) is None


def test_an_island_stays_over_the_plane_where_no_point_ties_its_parts_together() -> None:
    problem, seen, _ = sighted(survey(8), hill, 8)
    apart = only(seen, (seen.row < 14) == (seen.point % 2 == 0))
    assert grounded(problem, apart, SETTINGS) is None


def test_an_island_without_points_stays_over_the_plane() -> None:
    problem, seen, _ = sighted(survey(9), hill, 9)
    assert grounded(problem, only(seen, np.zeros(len(seen.row), bool)), SETTINGS) is None


def test_a_few_frames_stay_over_the_plane() -> None:
    problem, seen, _ = sighted(survey(10, lines=1, per_line=FEWEST_FRAMES - 1), hill, 10)
    assert grounded(problem, seen, SETTINGS) is None


def test_points_above_the_horizon_are_left_out_and_the_others_hold() -> None:
    truth = survey(11)
    problem, seen, _ = sighted(truth, hill, 11)
    sky = seen.point < 5
    pixels = np.where(sky[:, None], [100.0, 100.0], seen.pixels)
    found = held(problem, replace(seen, pixels=pixels), rough(truth, 11))
    assert abs(np.exp(found.lenses[0, 0]) / CAMERA.focal - 1) < 0.02
