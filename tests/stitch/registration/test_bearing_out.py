"""Whether the rest of an overlap bears a registration out, and which matches are kept apart to judge a map by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Matrix3x3
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.a_contrario import Confirmed, confirmed
from gcs_mosaic.stitch.registration.confirmation import MOST_BEYOND, borne_out, why_contradicted
from gcs_mosaic.stitch.registration.frame_pair import FramePair, MatchPart, frame_pair, robust_homography_among
from gcs_mosaic.stitch.registration.held_out import EVERY, PATCH, clear_of, held_out, held_out_doubtful
from gcs_mosaic.stitch.registration.outcome import NO_MATCHES, NotRegistered, Registration, well_spread
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SETTINGS = RegistrationSettings()
SIDE = np.array([400.0, 300.0])
POINTS = np.random.default_rng(0).uniform(0, 1, (600, 2)) * SIDE
STILL = np.eye(3)
NONE = np.zeros(600, bool)


def frame(points: np.ndarray = POINTS, scale: float = 1.0) -> Features:
    found = (points * scale).astype(np.float32)
    width, height = (SIDE * scale).astype(int).tolist()
    return Features(found, np.zeros((len(points), 128), np.uint8), width, height, scale)


def pair(again_a: np.ndarray = NONE, again_b: np.ndarray = NONE) -> FramePair:
    return frame_pair(frame(), frame(), MatchPart(again=again_a), MatchPart(again=again_b), NO_MATCHES)


def near(x: float, share: float = 1.0) -> np.ndarray:
    """Points up to this x, a share of them."""
    chosen = POINTS[POINTS[:, 0] < x]
    return np.asarray(chosen[: round(share * len(chosen))])


@pytest.mark.parametrize(("x", "told"), [(400, ""), (200, ""), (120, ""), (40, "of the overlap agrees")])
def test_an_overlap_of_which_little_agrees_is_contradicted(x: float, told: str) -> None:
    assert why_contradicted(pair(), STILL, near(x), SETTINGS).endswith(told)
    assert bool(why_contradicted(pair(), STILL, near(x), SETTINGS)) is bool(told)


def test_what_was_matched_before_must_match_again() -> None:
    """Of the features that were matched before hardly any agrees, though a third of the overlap does."""
    again = POINTS[:, 0] > 150
    for both in ((again, again), (NONE, again), (again, NONE)):
        assert why_contradicted(pair(*both), STILL, near(150), SETTINGS).endswith("of what was matched before agrees")


def test_where_all_that_was_matched_before_agrees_the_rest_need_not() -> None:
    """As in woods, where few features are ever matched."""
    again = POINTS[:, 0] < 70
    assert why_contradicted(pair(), STILL, near(70), SETTINGS)
    assert why_contradicted(pair(again, again), STILL, near(70), SETTINGS) == ""


def test_pixels_speak_for_an_overlap_to_some_extent() -> None:
    """By a decade at most: it outweighs a little that speaks against it, and not much."""
    little = (POINTS[:, 0] > 200) & (POINTS[:, 1] < 45)
    much = POINTS[:, 0] > 150
    for again, borne in ((little, True), (much, False)):
        assert why_contradicted(pair(again, again), STILL, near(150), SETTINGS, 0.0)
        said = why_contradicted(pair(again, again), STILL, near(150), SETTINGS, 9.0)
        assert (said == "") is borne
        assert said == why_contradicted(pair(again, again), STILL, near(150), SETTINGS, MOST_BEYOND)


def test_too_few_cells_of_what_was_matched_before_tell_nothing() -> None:
    again = (POINTS > [360, 260]).all(axis=1)
    assert why_contradicted(pair(again, again), STILL, near(200), SETTINGS) == ""


def moved(x: float) -> Matrix3x3:
    return np.array([[1, 0, x], [0, 1, 0], [0, 0, 1.0]])


def test_only_what_both_frames_see_counts() -> None:
    """Half of each frame is beyond the other."""
    half = POINTS[POINTS[:, 0] >= 200]
    assert why_contradicted(pair(), moved(-200), half, SETTINGS) == ""
    assert why_contradicted(pair(), moved(-200), near(200), SETTINGS).endswith("of the overlap agrees")


def registration(pixels: np.ndarray, beyond: float = 0.0) -> Registration:
    return Registration(pixels, pixels, np.zeros((len(pixels), 2), np.intp), STILL, 30, 20.0, beyond=beyond)


def test_a_registration_is_judged_anew_by_what_is_known_now() -> None:
    """In full-resolution pixels, twice as many as those of the features."""
    a, b, found = frame(scale=2.0), frame(scale=2.0), registration(near(150) * 2)
    assert borne_out(found, a, b, SETTINGS, MatchPart(), MatchPart()) is found
    again = MatchPart(again=POINTS[:, 0] > 150)
    refused = borne_out(found, a, b, SETTINGS, again, again)
    assert isinstance(refused, NotRegistered)
    assert refused.reason.endswith("of what was matched before agrees")
    assert (refused.inliers, len(refused.pixels_a), len(refused.pixels_b)) == (30, len(near(150)), len(near(150)))


def test_patches_prove_nothing_unless_pixels_do() -> None:
    pixels = np.arange(12.0).reshape(6, 2)
    matched = replace(registration(pixels), features=np.zeros((4, 2), np.intp), displaced_a=pixels[:1])
    assert len(matched.proved.pixels_a) == len(matched.proved.pixels_b) == 4
    assert len(matched.agreeing_a) == 5
    assert replace(matched, beyond=2.0).proved.pixels_a is pixels
    assert replace(matched, features=np.zeros((0, 2), np.intp)).proved.pixels_a is pixels


def test_a_cell_counts_if_both_frames_have_three_features_in_it() -> None:
    spots = np.array([[5.0, 5], [95, 5], [5, 95], [95, 95]])
    dense = np.concatenate([spots + np.array([dx, 0.0]) for dx in range(3)])
    assert confirmed(dense, dense[:8], dense[:1]).cells < confirmed(dense, dense, dense[:1]).cells
    assert confirmed(dense[:3], dense[:3], dense[:1]).share == 1.0
    assert confirmed(dense[:2], dense[:3], dense[:1]) == Confirmed(1.0, 0)
    assert confirmed(dense, dense, dense[:0]).share == 0.0


@pytest.mark.parametrize(("left", "found"), [(4, False), (5, True)])
def test_a_homography_needs_a_match_more_than_determine_it(left: int, found: bool) -> None:
    both = np.stack([np.arange(9)] * 2, axis=1)
    spread = frame(
        np.array([[10.0, 10], [300, 20], [30, 250], [350, 280], [200, 120], [90, 60], [5, 5], [6, 9], [9, 6]])
    )
    some = frame_pair(spread, spread, MatchPart(), MatchPart(), both)
    homography, inlier = robust_homography_among(some, np.arange(9) < left, 4.0)
    assert (homography is not None) is found
    assert inlier.tolist() == [found and at < left for at in range(9)]


def test_the_features_that_take_part_are_those_that_the_other_frame_should_see() -> None:
    seen = np.arange(600) % 3 == 0
    some = frame_pair(
        frame(), frame(scale=2.0), MatchPart(seen=seen, again=seen), MatchPart(), np.array([[2, 5]], np.intp)
    )
    assert some.features.tolist() == [[6, 5]]
    assert (len(some.all_a), len(some.all_b)) == (200, 600)
    assert some.again_a.all()
    assert not some.again_b.any()
    assert np.allclose(some.a[0], POINTS[6], atol=1e-3)
    assert np.allclose(some.b[0], POINTS[5], atol=1e-3)
    assert some.size_b.tolist() == some.size_a.tolist() == SIDE.tolist()


def test_every_so_many_features_are_held_out_with_all_their_matches() -> None:
    matches = np.array([[EVERY, 1], [1, EVERY * 3], [1, 2], [0, 5], [EVERY + 1, EVERY - 1]])
    assert held_out(matches).tolist() == [True, True, False, True, False]
    assert held_out_doubtful(matches, matches[1:3]).tolist() == matches[[0, 3]].tolist()
    assert len(held_out_doubtful(matches, matches)) == 0


@pytest.mark.parametrize(("apart", "clear"), [(0.99, False), (1.01, True)])
def test_patches_near_a_match_that_is_held_out_tell_of_it(apart: float, clear: bool) -> None:
    held, places = np.array([[100.0, 100.0], [900.0, 900.0]]), np.array([[100.0, 100.0 + apart * PATCH * 1000.0]])
    assert clear_of(places, held, 1000.0).tolist() == [clear]
    assert clear_of(places, held[:0], 1000.0).tolist() == [True]
    assert clear_of(places[:0], held, 1000.0).tolist() == []


def test_few_points_are_all_well_spread_and_the_first_of_many_lies_furthest_out() -> None:
    points = np.array([[0.0, 0], [1, 0], [2, 0], [10, 0]])
    assert well_spread(points, 4).tolist() == [0, 1, 2, 3]
    assert well_spread(points, 3).tolist() == [3, 0, 2]
    assert well_spread(points, 1).tolist() == [3]
