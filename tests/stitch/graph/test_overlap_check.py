"""A place is borne out by what lies around it, or it is not believed."""

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.features.frame_cells import COLUMNS, ROWS, cell_of
from gcs_mosaic.stitch.graph import overlap_check
from gcs_mosaic.stitch.graph.overlap_check import confirmed_around, odds_around
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.a_contrario import log_odds
from gcs_mosaic.stitch.registration.outcome import Registration

HERE = Pose(700, 700)


@pytest.fixture
def graph(ground: Image) -> ViewGraph:
    """A frame, not yet placed, and three around it: beside it, twice as high and more, looking aside."""
    graph = ViewGraph(SMALL_CAMERA.focal, 24)
    poses = [HERE, Pose(820, 700), Pose(700, 700, 0.9), Pose(700, 400, 0.3, 0, 0, -1.1)]
    for i, pose in enumerate(poses):
        graph.append(str(i), extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings()))
        if i:
            graph.put(i, pose, 0)
    return graph


def everywhere(graph: ViewGraph) -> Array:
    return graph.frames[0].features.points.astype(np.float64)


@pytest.mark.long
def test_matches_all_over_the_overlap_confirm_a_place(graph: ViewGraph) -> None:
    assert confirmed_around(graph, 0, HERE, 0, [1], [everywhere(graph)]).share == 1


@pytest.mark.long
def test_matches_on_one_thing_confirm_only_that(graph: ViewGraph) -> None:
    points = everywhere(graph)
    thing = points[((points > [250, 120]) & (points < [350, 200])).all(axis=1)]
    assert 0 < confirmed_around(graph, 0, HERE, 0, [1], [thing]).share < 0.25


@pytest.mark.long
def test_what_only_another_frame_should_see_is_not_asked_of_this_one(graph: ViewGraph) -> None:
    points = everywhere(graph)
    right = points[points[:, 0] > 120]
    assert confirmed_around(graph, 0, HERE, 0, [1], [right]).share == 1
    assert confirmed_around(graph, 0, Pose(820, 700), 0, [1], [right]).share < 0.8


def test_frames_that_see_the_ground_much_coarser_are_no_witnesses(graph: ViewGraph) -> None:
    assert confirmed_around(graph, 0, HERE, 0, [2], []).share == 1
    assert confirmed_around(graph, 0, HERE, 0, [3], []).share == 1
    assert confirmed_around(graph, 0, HERE, 0, [1, 2, 3], []).share == 0


@pytest.mark.parametrize("agrees", [True, False], ids=["what is left out", "what is asked"])
def test_ground_that_is_never_found_again_is_only_left_out_for_a_frame(
    graph: ViewGraph, monkeypatch: pytest.MonkeyPatch, agrees: bool
) -> None:
    """Never against it: what agrees is a witness wherever it lies."""
    silent = np.tile(np.arange(COLUMNS) >= COLUMNS // 2, ROWS)
    monkeypatch.setattr(overlap_check, "silent_cells", lambda *_: silent)
    points = everywhere(graph)
    found = points[silent[cell_of(points, SMALL_CAMERA.width, SMALL_CAMERA.height)] == agrees]
    link = Registration(found, found, np.stack([np.arange(len(found))] * 2, axis=1), np.eye(3), len(found), 99.0)
    plain = confirmed_around(graph, 0, HERE, 0, [1], [found])
    around, odds = odds_around(graph, 0, HERE, 0, {1: link}, least=99.0)
    assert odds >= log_odds(plain, graph.true_share)
    assert (around == plain) == agrees
