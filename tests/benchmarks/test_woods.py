"""The measure of woods, against maps that are right and maps that are not."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

import sitl.flight
from sitl.world import WOODS
from tests.benchmarks.woods import bare_ground, pair_errors, planned, shared_places, shots
from tests.sitl.sitl_parts import PIXEL, placements

ASKED = argparse.Namespace(ground=WOODS, frames=3, sway=0.4, display=False)


@pytest.fixture(scope="module")
def flight() -> sitl.flight.Flight:
    return planned(ASKED, 0.7, seed=1)


@pytest.mark.long
def test_of_a_right_map_the_ground_fits(flight: sitl.flight.Flight) -> None:
    bare = {name: bare_ground(flight.scene, state) for name, state in shots(flight)}
    gaps, shared = pair_errors(flight, placements(flight.truth()), bare)
    assert len(gaps) > 100
    assert shared == 1
    assert gaps.max() < 3  # the warp is exact on level ground, places are found to within the step of a ray


def test_a_frame_laid_aside_is_so_much_aside(flight: sitl.flight.Flight) -> None:
    wrong, truth = placements(flight.truth()), flight.truth()
    moved = np.eye(3)
    moved[0, 2] = 10 * truth.gsd * PIXEL
    middle = wrong["frames"][1]
    middle["canvas_from_frame"] = (moved @ np.array(middle["canvas_from_frame"])).tolist()
    canvas = np.array(middle["warp"]["canvas"])
    middle["warp"]["canvas"] = (canvas + moved[:2, 2]).tolist()
    bare = {name: bare_ground(flight.scene, state) for name, state in shots(flight)}
    gaps, _ = pair_errors(flight, wrong, bare)
    assert np.quantile(gaps, 0.9) == pytest.approx(10, abs=1.2)  # the similarity takes up some of it


def test_frames_on_islands_of_their_own_have_no_error(flight: sitl.flight.Flight) -> None:
    apart = placements(flight.truth())
    for number, frame in enumerate(apart["frames"]):
        frame["island"] = number
    bare = {name: bare_ground(flight.scene, state) for name, state in shots(flight)}
    gaps, shared = pair_errors(flight, apart, bare)
    assert (len(gaps), shared) == (0, 0)


def test_what_a_crown_hides_is_not_ground_that_both_see(flight: sitl.flight.Flight) -> None:
    one, other = flight.states[:2]
    bare = bare_ground(flight.scene, one)
    here, there = shared_places(flight.scene, bare, other)
    assert 0 < len(here) == len(there) < 0.95 * len(bare.pixels)
