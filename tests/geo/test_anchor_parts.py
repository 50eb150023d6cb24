"""The parts of which anchors are made: points of pins, ellipses, suppositions, lags."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_mosaic.geo import gross_errors, pins, positions
from gcs_mosaic.geo.anchor import Alternative, Anchor, ellipse, joined, similarity, split
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.geo.gross_errors import suppositions
from gcs_mosaic.geo.mercator import FINEST_LEVEL, ground_scale, level_of, mercator, tile_corner
from gcs_mosaic.geo.pins import UNUSUAL, misfit_of
from gcs_mosaic.geo.points import Pin, number_of_points, plane_of, points_by_pin, points_of
from gcs_mosaic.geo.positions import LAG_STEP_S, ShotPosition

PLANE = LocalPlane(7.0, 44.5)
AROUND_95 = math.sqrt(-2 * math.log(0.05))


def pin(name: str, x: float, east: float, *, sigma_m: float = 3.0) -> Pin:
    longitude, latitude = map(float, PLANE.places(np.array([east, 0.0])))
    return Pin(name, x, 0.0, longitude, latitude, sigma_m)


@pytest.mark.parametrize(
    ("names", "apart_m", "sigma_m", "one"),
    [
        (("a", "b"), 0.009, 3.0, True),
        (("a", "b"), 0.011, 3.0, False),
        (("a", " A "), 4 * math.hypot(3, 3) - 0.1, 3.0, True),
        (("a", "a"), 4 * math.hypot(3, 3) + 0.1, 3.0, False),
        (("a", "a"), 0.99, 0.01, True),
        (("a", "a"), 1.01, 0.01, False),
        (("", ""), 0.5, 3.0, False),
        ((" ", ""), 0.005, 3.0, True),
    ],
)
def test_pins_of_one_coordinate_or_of_one_name_and_near_are_of_one_point(
    names: tuple[str, str], apart_m: float, sigma_m: float, one: bool
) -> None:
    both = [pin(name, 10.0 * k, apart_m * k, sigma_m=sigma_m) for k, name in enumerate(names)]
    spots = np.array([0j, apart_m + 0j])
    assert points_by_pin(both, spots) == ((0, 0) if one else (0, 1))
    assert number_of_points(both) == (1 if one else 2)
    assert number_of_points([]) == 0


def test_two_groups_that_a_third_pin_joins_are_one_point() -> None:
    some = [pin("a", 0, 0.0), pin("b", 1, 50.0), pin("a", 2, 0.005), pin("b", 3, 0.0)]
    assert points_by_pin(some, np.array([0, 50, 0.005, 0]) + 0j) == (0, 1, 0, 0)
    chain = [pin("x", 0, 0.0), pin("y", 1, 0.015), pin("z", 2, 0.0075)]
    assert points_by_pin(chain, np.array([0, 0.015, 0.0075]) + 0j) == (0, 0, 0)


def test_a_point_lies_where_its_observations_do() -> None:
    """The mean of two, the median of more; the coordinate of more exact readings counts more."""
    two = [pin("a", 0.0, 0.0, sigma_m=1.0), pin("a", 6.0, 3.0, sigma_m=2.0)]
    found = points_of(two, np.array([0j, 6 + 0j]), np.array([0j, 3 + 0j]))
    assert found.places.tolist() == [3 + 0j]
    assert found.spots[0] == pytest.approx(3 * 0.25 / 1.25)
    assert (found.sigmas[0], found.supposed[0]) == (1.0, False)
    assert found.scatter[0] == pytest.approx(3 / math.sqrt(2))
    three = [pin("a", x, 0.0) for x in (0.0, 1.0, 80.0)]
    found = points_of(three, np.array([0j, 1 + 2j, 80 + 9j]), np.zeros(3, complex))
    assert found.places.tolist() == [1 + 2j]
    assert found.scatter[0] == pytest.approx(abs(1 + 2j) / math.sqrt(3))
    assert found.supposed.tolist() == [True]
    exact = points_of([pin("a", 0.0, 0.0, sigma_m=0.0)], np.zeros(1, complex), np.zeros(1, complex))
    assert exact.sigmas.tolist() == [0.01]


def test_the_plane_of_pins_is_in_their_middle() -> None:
    across = [Pin("a", 0, 0, 179.0, 10.0), Pin("b", 0, 0, -179.0, 20.0), Pin("c", 0, 0, -177.0, 30.0)]
    assert plane_of(across) == LocalPlane(181.0, 20.0)
    assert plane_of([]) == LocalPlane(0.0, 0.0)


@pytest.mark.parametrize(
    ("covariance", "major", "minor", "bearing"),
    [
        ([[9.0, 0.0], [0.0, 4.0]], 3.0, 2.0, 90.0),
        ([[4.0, 0.0], [0.0, 9.0]], 3.0, 2.0, 0.0),
        ([[6.5, 2.5], [2.5, 6.5]], 3.0, 2.0, 45.0),
        ([[6.5, -2.5], [-2.5, 6.5]], 3.0, 2.0, 135.0),
        ([[9.0, 0.0], [0.0, -1e-12]], 3.0, 0.0, 90.0),
    ],
)
def test_an_ellipse_holds_95_of_100_errors(
    covariance: list[list[float]], major: float, minor: float, bearing: float
) -> None:
    found = ellipse(np.array(covariance))
    assert (found.major_m, found.minor_m) == pytest.approx((AROUND_95 * major, AROUND_95 * minor), abs=1e-5)
    assert found.bearing_deg == pytest.approx(bearing)
    assert ellipse(np.array(covariance), 5.5).minor_m == pytest.approx(max(5.5, AROUND_95 * minor))


def anchor(*, alternatives: tuple[Alternative, ...] = (), least: float = 0.0, bend: float = 0.0) -> Anchor:
    rows = np.diag([0.01**2, 0.01**2, 4.0, 4.0])
    covariance = tuple(tuple(map(float, row)) for row in rows)
    return Anchor(
        plane=PLANE, turn=0.1j, shift=5 + 6j, middle=100 + 0j, covariance=covariance, map_error_m=bend,
        least_error_m=least, alternatives=alternatives,
    )  # fmt: skip


def test_the_error_grows_with_the_distance_from_the_middle() -> None:
    here, far = anchor().error(100.0, 0.0), anchor().error(400.0, -400.0)
    assert (here.major_m, here.minor_m) == pytest.approx((AROUND_95 * 2, AROUND_95 * 2))
    assert far.major_m == pytest.approx(AROUND_95 * math.hypot(2, 0.01 * 500))
    assert anchor(bend=3.0).error(100.0, 0.0).minor_m == pytest.approx(AROUND_95 * math.hypot(2, 3))
    assert anchor(least=50.0).error(100.0, 0.0).minor_m == 50.0
    exact = Anchor(plane=PLANE, turn=1j, shift=0j, middle=0j, covariance=((0.0,) * 4,) * 4)
    assert exact.error(9.0, 9.0).major_m == 0.0  # unless it is said that the map is bent, or a least error


def test_alternatives_tell_the_error_where_there_are_any() -> None:
    right = Alternative(0.5, 0.1j, 5 + 6j, 100 + 0j, 0.01**2, 4.0)
    told = anchor(alternatives=(right, right)).error(400.0, -400.0)
    assert told.major_m == told.minor_m == pytest.approx(AROUND_95 * math.hypot(2, 5), rel=0.02)
    assert told.bearing_deg == 0.0
    shifted = Alternative(0.5, 0.1j, 105 + 6j, 100 + 0j, 0.0, 1.0)
    assert anchor(alternatives=(right, shifted)).error(100.0, 0.0).major_m == pytest.approx(100.0 + 1.28, abs=0.4)
    turned = Alternative(0.5, 0.2j, 5 + 6j, 100 + 0j, 0.0, 0.0)
    assert anchor(alternatives=(turned,)).error(300.0, 0.0).major_m == pytest.approx(30.0)
    assert anchor(alternatives=(right,), least=80.0).error(100.0, 0.0).major_m == 80.0


def test_a_similarity_weighs_its_points() -> None:
    places = np.array([0j, 1 + 0j, 1j, 5 + 5j])
    turn, shift = similarity(places, (2 + 1j) * places + 3, np.ones(4))
    assert abs(turn - (2 + 1j)) + abs(shift - 3) < 1e-12
    spots = places.copy()
    spots[3] += 100
    turn, shift = similarity(places, spots, np.array([1, 1, 1, 1e-12]))
    assert abs(turn - 1) + abs(shift) < 1e-8
    assert split(joined(np.array([[3.0, 4.0]]))).tolist() == [[3.0, -4.0]]


def test_how_badly_pins_fit_by_the_worst_and_by_all() -> None:
    square = np.array([0j, 100, 100j, 100 + 100j])
    off = np.array([1, -1, -1, 1]) * 2.0 + 0j  # which no similarity explains
    sigmas = np.ones(4)
    most = 4 * (1 - 2 / 36 + UNUSUAL * math.sqrt(2 / 36)) ** 3
    assert misfit_of(square, square + off, sigmas) == pytest.approx(max(2 / 3, 16 / most))
    assert misfit_of(square, square + 3 * off, sigmas) == pytest.approx(max(2.0, 9 * 16 / most))
    assert misfit_of(square, square + 3 * off, 3 * sigmas) == pytest.approx(max(2 / 3, 16 / most))
    assert misfit_of(square[:2], square[:2] + off[:2], sigmas[:2]) == 0.0


def test_how_pins_turn_the_map_is_told_by_the_exact_ones() -> None:
    spots = np.array([0j, 100 + 0j])
    assert pins._turn_sigma(spots, np.array([1.0, 1.0])) == pytest.approx(math.sqrt(2) / 100)
    assert pins._turn_sigma(spots, np.array([1.0, 7.0])) == pytest.approx(math.sqrt(50) / 100)
    assert pins._turn_sigma(spots * 0, np.ones(2)) == math.inf


def supposed(off: complex, count: int = 6) -> list[gross_errors.Supposition]:
    angles = np.exp(2j * math.pi * np.arange(count) / count)
    places, spots = 1000 * angles, 50 * angles
    spots[2] += off
    ones = np.ones(count)
    return suppositions(places, spots, ones, 0 * ones, np.zeros(count, bool))


def test_weights_of_suppositions_add_up_and_the_likeliest_comes_first() -> None:
    for off, wrong in ((0j, frozenset[int]()), (60 + 0j, frozenset([2]))):
        told = supposed(off)
        weights = [one.weight for one in told]
        assert sum(weights) == pytest.approx(1.0, abs=0.02)
        assert weights == sorted(weights, reverse=True)
        assert told[0].wrong == wrong
        assert told[0].weight > 0.85


def test_how_many_are_wrong_is_likely_as_stated_before() -> None:
    """Half of the sets have none; each further wrong one is a tenth as likely; all sets of one size alike."""
    likely = [math.exp(gross_errors._before(wrong, 6)) * math.comb(6, wrong) for wrong in range(4)]
    assert likely == pytest.approx([0.5, 0.45, 0.045, 0.0045])


@pytest.mark.parametrize(
    ("costs", "lag"),
    [
        ({-1: 2.0, 0: 1.0, 1: 2.0}, 0.0),
        ({-1: 2.0, 0: 1.0, 1: 1.5}, 1 / 6),
        ({4: 1.5, 5: 1.0, 6: 2.0}, 5 - 1 / 6),
        ({0: 1.0, 1: 1.5}, 0.0),
        ({-1: 1.5, 0: 1.0}, 0.0),
        ({-1: 1.0, 0: 1.0, 1: 1.0}, -1.0),
    ],
)
def test_the_lowest_of_a_parabola_through_the_costs(costs: dict[int, float], lag: float) -> None:
    assert positions._lowest(costs) == pytest.approx(LAG_STEP_S * lag)


def flown(*times: float) -> positions._Flown:
    shots = [ShotPosition(time, 10 * time, 0.0, 7.0 + 1e-4 * time, 44.5) for time in times]
    return positions._flown(PLANE, shots)


@pytest.mark.parametrize(("gap", "known"), [(8.0, True), (8.1, False)])
def test_beside_a_gap_the_path_is_not_known(gap: float, known: bool) -> None:
    """A gap is four times as long as is usual."""
    times = [0.0, 2, 4, 6, 8, 8 + gap, 10 + gap, 12 + gap, 14 + gap]
    found = flown(*times)
    assert found.trusted.tolist() == [1, 1, 1, 1, float(known), float(known), 1, 1, 1]
    moved = positions._moved(found, 0.5)
    assert moved.real.tolist() == pytest.approx(
        [10 * (t + (0.5 if ok else 0)) for t, ok in zip(times, found.trusted, strict=True)]
    )


def test_of_shots_at_one_moment_the_first_counts_and_time_orders_them() -> None:
    found = flown(4.0, 0.0, 2.0, 2.0)
    assert found.times.tolist() == [0.0, 2.0, 4.0]
    assert found.places.real.tolist() == [0.0, 20.0, 40.0]


@pytest.mark.parametrize("lag", [-3.0, -0.5, 0.0, 0.7, 3.0])
def test_where_a_camera_was_a_while_after_each_shot(lag: float) -> None:
    """Beyond the first and the last shot as fast as beside them."""
    assert positions._moved(flown(*range(0, 20, 2)), lag).real == pytest.approx(10 * (np.arange(0, 20, 2) + lag))


def test_where_few_shots_are_beside_no_gap_all_are_used() -> None:
    eight, seven = flown(*range(8), 100.0, 101.0), flown(*range(7), 100.0, 101.0)
    assert (eight.trusted.sum(), seven.trusted.sum()) == (8, 7)
    assert positions._used(eight).sum() == 8
    assert positions._used(seven).sum() == 9


def test_the_plane_of_positions_is_at_their_median() -> None:
    shots = [ShotPosition(k, 0, 0, longitude, k) for k, longitude in enumerate((179.5, -179.5, -179.0))]
    assert positions._plane(shots) == LocalPlane(180.5, 1.0)


def test_levels_of_tiles_are_the_nearest_as_factors_go() -> None:
    assert ground_scale(60.0) == pytest.approx(0.5)
    whole = 2 * math.pi * 6378137.0 / 256
    assert [level_of(whole / factor, 0.0) for factor in (1.0, 1.4, 1.42, 2.0, 2.8, 2.9)] == [0, 0, 1, 1, 1, 2]
    assert level_of(whole / 2, 60.0) == 0
    assert level_of(1e-9, 0.0) == FINEST_LEVEL
    assert tile_corner(2, 0, 3) == pytest.approx((-math.pi * 6378137.0, -math.pi * 6378137.0 / 2))
    assert mercator(np.array([0.0, 89.9]))[1] == pytest.approx(math.pi * 6378137.0)
