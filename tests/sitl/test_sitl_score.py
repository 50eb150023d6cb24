from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sitl.flight import Flight
from sitl.score import score
from sitl.similarity import robust_similarity, similarity
from sitl.truth import Truth
from sitl.warp import placed_frame, project
from tests.sitl.sitl_parts import CANVAS_FROM_GROUND, PIXEL, entry, pinhole, placements


def shifted(place: dict[str, Any], pixels: float, truth: Truth) -> dict[str, Any]:
    move = np.eye(3)
    move[0, 2] = pixels * truth.gsd * PIXEL
    return {"name": place["name"], "island": 0, "canvas_from_frame": (move @ place["canvas_from_frame"]).tolist()}


@pytest.fixture(scope="module")
def truth(flight: Flight) -> Truth:
    return flight.truth()


@pytest.fixture(scope="module")
def straight(flight: Flight) -> Truth:
    """The truth of the same flight with a lens that does not bend: homographies are exact."""
    camera = replace(flight.scene.camera, lens=replace(flight.scene.camera.lens, k1=0.0))
    return replace(flight, scene=replace(flight.scene, camera=camera)).truth()


def test_the_truth_itself_scores_perfectly_in_any_canvas(straight: Truth) -> None:
    found = score(straight, placements(straight, warp=False))
    assert (found.frames, found.placed, found.islands, found.largest, found.alone) == (12, 12, 1, 12, 0)
    assert found.ortho_rmse < 1e-6
    assert found.pair_p95 < 1e-3
    assert found.pairs > 500
    assert found.scale_p5 == pytest.approx(1)
    assert found.scale_p95 == pytest.approx(1)


def test_the_warp_carries_the_lens(truth: Truth) -> None:
    with_lens, without = (score(truth, placements(truth, warp)) for warp in (True, False))
    assert with_lens.ortho_rmse < 0.02
    assert with_lens.pair_p95 < 0.05
    assert without.ortho_rmse > 1
    assert without.pair_p95 > 2


def test_one_misplaced_frame_is_seen_for_what_it_is(straight: Truth) -> None:
    given = placements(straight, warp=False)
    given["frames"][5] = shifted(given["frames"][5], 10, straight)
    found = score(straight, given)
    assert found.ortho_worst_frame == pytest.approx(10, rel=0.05)
    assert found.ortho_median < 0.1
    assert found.pair_p95 == pytest.approx(10, rel=0.1)


def test_two_frames_swapped_are_seen(straight: Truth) -> None:
    given = placements(straight, warp=False)
    one, other = given["frames"][0], given["frames"][7]
    one["name"], other["name"] = other["name"], one["name"]
    assert score(straight, given).ortho_worst_frame > 100


def test_a_drifting_scale_is_seen(straight: Truth) -> None:
    given = placements(straight, warp=False)
    for k, place in enumerate(given["frames"]):
        frame = straight.frames[k]
        about = project(np.array(place["canvas_from_frame"]), np.array([straight.lens.centre]))[0]
        size = 1 + 0.02 * k
        grow = np.array([[size, 0, about[0] * (1 - size)], [0, size, about[1] * (1 - size)], [0, 0, 1]])
        place["canvas_from_frame"] = (grow @ pinhole(straight.lens, frame)).tolist()
    found = score(straight, given)
    assert found.scale_p95 / found.scale_p5 == pytest.approx(1.2, abs=0.03)


def test_each_island_is_laid_by_itself_and_a_single_frame_is_not_placed(straight: Truth) -> None:
    given = placements(straight, warp=False)
    for place in given["frames"][6:]:
        turn = np.array([[0, -2, 40], [2, 0, 9], [0, 0, 1]])
        place["island"], place["canvas_from_frame"] = 3, (turn @ place["canvas_from_frame"]).tolist()
    given["frames"][0]["island"] = 8
    found = score(straight, given)
    assert (found.islands, found.placed, found.alone, found.largest) == (2, 11, 1, 6)
    assert found.ortho_rmse < 1e-6


def test_names_match_whole_or_by_their_last_part(straight: Truth) -> None:
    given = placements(straight, warp=False)
    given["frames"][0]["name"] = given["frames"][0]["name"].rsplit("/", 1)[1]
    given["frames"][1]["name"] = "IMG_9999.JPG"
    found = score(straight, given)
    assert found.placed == 11
    assert found.unknown == ("IMG_9999.JPG",)


def test_a_frame_sent_to_the_horizon_costs_dearly_but_breaks_nothing(straight: Truth) -> None:
    given = placements(straight, warp=False)
    given["frames"][2]["canvas_from_frame"][2] = [0.01, 0, -2.0]
    found = score(straight, given)
    assert found.ortho_worst_frame > 1e4
    assert found.ortho_median < 0.1


def test_nothing_placed_is_told_without_numbers(truth: Truth) -> None:
    found = score(truth, {"frames": []})
    assert found.placed == found.islands == found.pairs == 0
    assert math.isnan(found.ortho_rmse)
    assert "placed 0/12" in str(found)


def test_a_homography_may_come_with_either_sign(straight: Truth) -> None:
    given = placements(straight, warp=False)
    for place in given["frames"]:
        place["canvas_from_frame"] = (-np.array(place["canvas_from_frame"])).tolist()
    assert score(straight, given).ortho_rmse < 1e-6


def test_a_warp_is_met_exactly_at_its_points(truth: Truth) -> None:
    given = entry(truth.lens, truth.frames[3], warp=True)
    placed = placed_frame(given, np.array(truth.lens.centre))
    x, y = given["warp"]["x"][7], given["warp"]["y"][31]
    assert np.allclose(placed.canvas(np.array([[x, y]])), given["warp"]["canvas"][31][7])


def test_a_similarity_is_found_again_despite_strays() -> None:
    source = np.random.default_rng(1).uniform(0, 900, (60, 2))
    target = project(CANVAS_FROM_GROUND, source)
    assert np.allclose(similarity(source, target, np.ones(60)), CANVAS_FROM_GROUND)
    target[:12] += 400
    assert np.allclose(robust_similarity(source, target), CANVAS_FROM_GROUND, rtol=1e-3, atol=0.5)


def test_a_similarity_never_mirrors() -> None:
    source = np.random.default_rng(1).uniform(-1, 1, (60, 2))
    found = similarity(source, source * [1, -1], np.ones(60))
    assert np.linalg.det(found) >= 0
