"""The scoring of joins tells false ones from right ones: each is given placements of which the answer is known."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.graph.placement import Placement
from sitl.geometry import ground_from_pixels
from tests.benchmarks.joins import APART, LAID_ASTRAY, RIGHT, STRANGERS, found_islands, judged, overlap, returns
from tests.benchmarks.look_alikes import (
    LENS,
    Later,
    Taken,
    Visit,
    grid,
    name_of,
    number_of,
    seen_by,
    states,
    taken,
    visits,
)

CAMERA = Camera(LENS.width, LENS.height, LENS.focal, LENS.k1)
LATER = Later(grown=0.0, height=1.4, heading=2.0, sun=1, gain=1.0, gamma=1.0, cast=(1.0, 1.0, 1.0))
FIRST = Visit(land=0, ground="country", first=0, frames=12)
ELSEWHERE = Visit(land=1, ground="country", first=12, frames=12)
SECOND = replace(FIRST, first=24, later=LATER)


@pytest.fixture(scope="module")
def truth() -> list[Taken]:
    return taken([FIRST, ELSEWHERE, SECOND])


def placed(
    number: int, truth: list[Taken], island: int = 0, east: float = 0.0, links: tuple[int, ...] = ()
) -> Placement:
    """A frame where it was taken, or so many metres from there."""
    state = truth[number].state
    pose = Pose(
        state.x + east, state.y, np.log(state.height / LENS.focal_px), *angles(state.yaw, state.pitch, state.roll)
    )
    names = tuple(map(name_of, links))
    return Placement(name_of(number), island, pose, CAMERA, None, 100, 0.3, names, 1, 1.0)


def angles(yaw: float, pitch: float, roll: float) -> tuple[float, float, float]:
    """The same rotation by the program's angles: rotations about other axes, whose signs differ."""
    return yaw, -roll, pitch


def test_truth_and_placements_speak_of_one_camera(truth: list[Taken]) -> None:
    found = found_islands([placed(k, truth) for k in range(12)], truth, {})
    assert [one.far for one in found] == [()]


def test_an_island_of_two_lands_is_a_false_join(truth: list[Taken]) -> None:
    found = found_islands([placed(k, truth) for k in range(15)], truth, {})
    assert [(one.lands, one.strangers, one.is_false) for one in found] == [(Counter({0: 12, 1: 3}), 3, True)]


def test_islands_of_one_land_each_are_none(truth: list[Taken]) -> None:
    found = found_islands([placed(k, truth, island=k // 12) for k in range(24)], truth, {})
    assert [one.is_false for one in found] == [False, False]


def test_frames_laid_far_off_are_a_false_join(truth: list[Taken]) -> None:
    aside = [placed(k, truth, east=25.0 if k in (10, 11) else 0.0) for k in range(12)]
    assert [(one.far, one.is_false) for one in found_islands(aside, truth, {})] == [((10, 11), True)]


def test_false_registrations_that_became_links_are_named(truth: list[Taken]) -> None:
    kinds = {(0, 1): RIGHT, (1, 13): STRANGERS, (2, 3): LAID_ASTRAY}
    found = found_islands([placed(0, truth, links=(1,)), placed(1, truth, links=(0, 13))], truth, kinds)
    assert [one.false_links for one in found] == [((1, 13),)]


def test_registrations_are_judged_by_what_their_pixels_show(truth: list[Taken]) -> None:
    a, near, pixels = truth[0], truth[1], grid()
    there = seen_by(near.state, a.state, pixels)
    assert judged(a, near, pixels, there) == RIGHT
    assert judged(a, near, pixels, there + np.array([7, 0])) == LAID_ASTRAY
    assert judged(a, truth[12], pixels, there) == STRANGERS
    beyond = next(one for one in truth[:12] if not overlap(a, one))
    assert judged(a, beyond, pixels, there) == APART


@pytest.mark.parametrize(("island", "joined"), [(0, 12), (1, 0)])
def test_a_second_visit_on_an_island_of_its_own_is_missed(truth: list[Taken], island: int, joined: int) -> None:
    placements = [placed(k, truth) for k in range(12)] + [placed(k, truth, island) for k in range(24, 36)]
    compared, kinds = [(0, 1), (0, 30), (1, 13), (2, 31)], {(0, 1): RIGHT, (0, 30): RIGHT, (2, 31): LAID_ASTRAY}
    (found,) = returns(placements, truth, compared, kinds)
    assert (found.visit, found.placed, found.joined, found.compared, found.registered) == (SECOND, 12, joined, 2, 1)


def test_an_archive_has_as_many_frames_as_were_asked_for_and_second_visits_last() -> None:
    flights = visits(1000)
    assert [one.first for one in flights] == np.cumsum([0, *(one.frames for one in flights)])[:-1].tolist()
    assert 1000 <= len(taken(flights)) < 1050
    again = [one.later is not None for one in flights]
    assert again == sorted(again)
    assert any(again)


def test_a_second_visit_sees_ground_of_the_first() -> None:
    for later in (one for one in visits(3000) if one.later):
        first = replace(later, later=None, first=0)
        assert all(any(overlap(Taken(later, b), Taken(first, a)) for a in states(first)) for b in states(later))
        corners = [ground_from_pixels(LENS, state, grid()) for state in states(later)]
        assert np.abs(np.concatenate(corners)).max() < 140


def test_names_have_numbers() -> None:
    assert number_of(name_of(1234)) == 1234
