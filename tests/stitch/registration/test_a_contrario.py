"""Chance finds what the model expects of it, and an overlap that is one is borne out all over."""

import math

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.registration.a_contrario import (
    CORRELATED_CELLS,
    FALSE_SHARE,
    Confirmed,
    chance_of_agreement,
    confirmed,
    log_evidence,
    log_odds,
)
from gcs_mosaic.stitch.registration.homography import robust_homography

SIDE = np.array([1000.0, 750.0])
RADIUS = 4.0
DISC = math.pi * RADIUS**2 / SIDE.prod()


def test_evidence_grows_with_inliers_and_shrinks_with_matches_and_chance() -> None:
    assert log_evidence(50, 12, DISC) > log_evidence(50, 11, DISC)
    assert log_evidence(50, 12, DISC) > log_evidence(60, 12, DISC)
    assert log_evidence(50, 12, DISC) > log_evidence(50, 12, 2 * DISC)
    assert log_evidence(50, 4, DISC) == -math.inf


def test_the_model_counts_as_moisan_and_stival_do() -> None:
    """All of 6 matches: 2 * C(6, 6) * C(6, 4) * chance^2 false alarms."""
    assert log_evidence(6, 6, 0.01) == pytest.approx(-math.log10(2 * 15 * 0.01**2))
    assert log_evidence(5, 5, 0.01) == pytest.approx(-math.log10(1 * 5 * 0.01))
    assert log_evidence(3, 3, 0.01, sample=2) == pytest.approx(-math.log10(1 * 3 * 0.01))


def test_random_matches_never_amount_to_evidence() -> None:
    """At least one false alarm is expected of what chance finds, whatever the number of matches."""
    rng = np.random.default_rng(1)
    most = -math.inf
    for n in [20, 60, 200] * 15:
        a, b = rng.uniform(0, SIDE, (n, 2)), rng.uniform(0, SIDE, (n, 2))
        homography, inlier = robust_homography(a, b, RADIUS)
        assert homography is not None
        mapped = cv2.perspectiveTransform(a[None], homography)[0]
        chance = chance_of_agreement(mapped, b, RADIUS, SIDE.prod())
        most = max(most, log_evidence(n, int(inlier.sum()), chance))
    assert most < 0


def test_evenly_spread_points_agree_as_the_disc_says_and_crowded_ones_oftener() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.uniform(0, SIDE, (2, 1500, 2))
    assert chance_of_agreement(a, b, RADIUS, SIDE.prod()) == pytest.approx(DISC, rel=0.2)
    assert chance_of_agreement(a * 0.2, b * 0.2, RADIUS, SIDE.prod()) > 15 * DISC


def test_true_matches_do_not_count_as_chance() -> None:
    a = np.random.default_rng(3).uniform(0, SIDE, (80, 2))
    assert chance_of_agreement(a, a, RADIUS, SIDE.prod()) < 5 * DISC


def test_matches_in_one_corner_do_not_bear_out_an_overlap() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.uniform(0, SIDE, (2, 1200, 2))
    everywhere = a[::5]
    corner = a[(a < SIDE / 3).all(axis=1)]
    assert confirmed(a, b, everywhere).share > 0.8
    assert confirmed(a, b, corner).share < 0.2


def test_ground_that_only_one_frame_shows_features_of_is_not_held_against_an_overlap() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.uniform(0, SIDE, (1200, 2)), rng.uniform(0, SIDE * [0.5, 1], (600, 2))
    assert confirmed(a, b, b[::5]).share > 0.8
    assert confirmed(a[:2], b, a[:0]) == Confirmed(1.0, 0)


def test_the_odds_are_those_of_so_many_cells_that_are_confirmed_or_not() -> None:
    """All of so many independent cells: each is so many times likelier on common ground than on look-alikes."""
    cells = 4 * CORRELATED_CELLS
    assert log_odds(Confirmed(1.0, cells), 0.8) == pytest.approx(4 * math.log10(0.8 / FALSE_SHARE))
    assert log_odds(Confirmed(0.0, cells), 0.8) == pytest.approx(4 * math.log10(0.2 / (1 - FALSE_SHARE)))


def test_what_true_overlaps_show_speaks_for_one_and_what_look_alikes_show_against_it() -> None:
    for cells in (3, 12, 48):
        assert log_odds(Confirmed(0.8, cells), 0.8) > 0
        assert log_odds(Confirmed(FALSE_SHARE, cells), 0.8) < 0
    assert log_odds(Confirmed(0.8, 48), 0.8) > log_odds(Confirmed(0.8, 12), 0.8)
    assert log_odds(Confirmed(1.0, 0), 0.8) == 0


def test_where_true_overlaps_confirm_little_as_much_says_more() -> None:
    """In woods half of the cells are no reason for doubt, over fields they are."""
    half = Confirmed(0.5, 30)
    assert log_odds(half, 0.5) > log_odds(half, 0.8)
