from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from shapely import Polygon

from sitl.geometry import CameraState, Lens, ground_from_pixels, resolution
from sitl.path import CLIMB_RATIO, SCENARIOS, Plan, fly
from sitl.truth import COARSEST, grid_of

LENS = Lens(width=640, height=480)
CORNERS = np.array([[0, 0], [639, 0], [639, 479], [0, 479]], np.float64)


def footprints(states: list[CameraState]) -> list[Polygon]:
    return [Polygon(ground_from_pixels(LENS, state, CORNERS)) for state in states]


def overlap(one: Polygon, other: Polygon) -> float:
    return float(one.intersection(other).area / min(one.area, other.area))


def linked(places: list[Polygon], least: float = 0.3) -> list[set[int]]:
    """Groups of frames that hang together by overlaps of at least this share."""
    groups: list[set[int]] = []
    for k, place in enumerate(places):
        touched = [group for group in groups if any(overlap(place, places[i]) > least for i in group)]
        groups = [group for group in groups if group not in touched] + [{k}.union(*touched)]
    return groups


@pytest.mark.parametrize("scenario", sorted(SCENARIOS.keys() - {"mission"}))
def test_a_scenario_is_repeatable_and_stays_over_known_ground(scenario: str) -> None:
    plan = Plan(strangers=2, seed=4)
    states = fly(scenario, LENS, plan)
    assert states == fly(scenario, LENS, plan)
    assert 24 <= len(states) <= 40
    assert (np.diff([state.time for state in states]) > 0).all()
    for state in states:
        coarse = resolution(LENS, state, grid_of(LENS))
        seen = ground_from_pixels(LENS, state, grid_of(LENS)[coarse <= COARSEST * np.nanmin(coarse)])
        assert np.abs(seen).max() < 307


@pytest.mark.parametrize("scenario", ["survey", "climb", "lost"])
def test_looking_down_means_within_the_tilt(scenario: str) -> None:
    states = fly(scenario, LENS, Plan(tilt=0.05))
    tilts = np.array([[state.pitch, state.roll] for state in states])
    assert np.abs(tilts).max() <= 0.05
    assert np.std(tilts) > 0.01


def test_a_survey_overlaps_as_planned() -> None:
    places = footprints(fly("survey", LENS, Plan(frames=30, forward=0.7, side=0.5, tilt=0.01)))
    along = [overlap(a, b) for a, b in pairwise(places)]
    assert 0.6 < np.median(along) < 0.8
    assert len(linked(places)) == 1


@pytest.mark.parametrize("frames", [1, 7, 200, 3000])
def test_a_survey_has_as_many_frames_as_asked(frames: int) -> None:
    assert len(fly("survey", LENS, Plan(frames=frames))) == frames


def test_a_climb_ends_three_times_as_high_and_hangs_together() -> None:
    states = fly("climb", LENS, Plan(frames=24))
    assert states[-1].height / states[0].height == pytest.approx(CLIMB_RATIO, rel=0.06)
    assert len(linked(footprints(states))) == 1


def test_lost_ground_comes_back() -> None:
    places = footprints(fly("lost", LENS, Plan()))
    breaks = [k for k in range(1, len(places)) if overlap(places[k - 1], places[k]) == 0]
    assert len(breaks) == 1, "one jump"
    before, after = places[: breaks[0]], places[breaks[0] :]
    alone = next(k for k in range(len(after)) if overlap(after[k], before[-1]) > 0)
    assert alone >= 3
    assert len(linked(before)) == len(linked(after[:3])) == 1
    assert all(overlap(a, b) == 0 for a in before for b in after[:3])
    assert len(linked(places)) == 1, "the way back bridges the gap"


def test_strangers_never_meet_anything() -> None:
    groups = linked(footprints(fly("lost", LENS, Plan(strangers=2))), least=0.0)
    assert sorted(map(len, groups))[:2] == [1, 1]
    assert len(groups) == 3


def test_oblique_frames_see_the_sky_and_the_others_do_not() -> None:
    states = fly("oblique", LENS, Plan())
    skies = [np.isnan(ground_from_pixels(LENS, state, CORNERS)).any() for state in states]
    tilted = [state.pitch > np.radians(45) for state in states]
    assert sum(tilted) == 6
    assert sum(skies) >= 4
    assert not any(sky and not tilt for sky, tilt in zip(skies, tilted, strict=True))


def test_wind_from_the_west_turns_the_nose_into_it() -> None:
    calm, windy = (fly("survey", LENS, Plan(wind=wind)) for wind in (0.0, 4.0))
    turned = np.array([b.yaw - a.yaw for a, b in zip(calm, windy, strict=True)])
    north = np.abs(np.cos([state.yaw for state in calm]) - 1) < 0.5
    assert (turned[north] < -0.2).all()
    assert (turned[~north] > 0.2).all()


def test_a_survey_can_climb_to_three_times_its_height_and_come_down_again() -> None:
    states = fly("survey", LENS, Plan(frames=120, height=50, climbs=2))
    heights = np.array([state.height for state in states])
    assert heights.min() > 47
    assert 140 < heights.max() < 160
    low = heights < 55
    assert np.count_nonzero(np.diff(low.astype(int)) == 1) == 2  # it comes down twice
    assert len(linked(footprints(states))) == 1
