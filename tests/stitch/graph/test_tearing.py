"""How far a map tears held-out matches apart: as much as it really does, and nothing is fitted to them."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from stitch_ground import SMALL_CAMERA, Image, seen

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.island import adjust_island
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid, pixels_from_canvas
from gcs_mosaic.stitch.camera.relief import ReliefSettings
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.tearing import HeldOut, Tearing, torn_apart
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.registration.held_out import EVERY
from gcs_mosaic.stitch.registration.outcome import Registration

CAMERA = Camera(1000, 750, focal=1.3)
POSES = [Pose(x, y, 0.0, yaw) for x, y, yaw in ((0, 0, 0.1), (350, 20, 0), (-20, 300, 3), (330, 280, -0.2))]
POINTS = 3000
NOISE_PX = 0.5
RELIEF = ReliefSettings()


def views_of(heights: float | Array = 0.0) -> list[Array]:
    """Pixels (POINTS, 2) of the same points of the ground in each frame, half a pixel off; NaN outside of it."""
    noise = np.random.default_rng(2)
    ground = noise.uniform([-600, -500], [1000, 900], (POINTS, 2))
    views = []
    for pose in POSES:
        below, height = np.array([pose.x, pose.y]), math.exp(pose.log_gsd) * CAMERA.focal_px
        shadow = below + (ground - below) * (height / (height - np.broadcast_to(heights, POINTS)))[:, None]
        pixels = pixels_from_canvas(pose, CAMERA, shadow) + noise.normal(0, NOISE_PX, ground.shape)
        inside = np.asarray(((pixels >= 0) & (pixels <= [CAMERA.width - 1, CAMERA.height - 1])).all(axis=1))
        views.append(np.where(inside[:, None], pixels, np.nan))
    return views


def network_of(
    views: Sequence[Array], accepted: NDArray[np.bool_] | None = None, poses: Sequence[Pose] = POSES
) -> ViewGraph:
    """Frames at these poses, linked by all that two see; only `accepted` (POINTS,) are inliers."""
    accepted = np.ones(POINTS, bool) if accepted is None else accepted
    graph = ViewGraph(CAMERA.focal, 24)
    graph.found_island()
    for number, (pose, view) in enumerate(zip(poses, views, strict=True)):
        points = np.nan_to_num(view).astype(np.float32)
        graph.append(str(number), Features(points, np.zeros((POINTS, 128), np.uint8), 1000, 750, 1.0))
        graph.put(number, pose, 0)
    for a in range(len(views)):
        for b in range(a):
            both = np.isfinite(views[a]).all(axis=1) & np.isfinite(views[b]).all(axis=1)
            all_seen, known = np.flatnonzero(both), np.flatnonzero(both & accepted)
            ends = views[a][known], views[b][known], np.stack([known, known], axis=1)
            found = Registration(*ends, np.eye(3), len(known), 99.0, tentative=np.stack([all_seen, all_seen], axis=1))
            graph.link(a, b, found)
    return graph


def torn(graph: ViewGraph) -> HeldOut:
    """What is found of the first island, which must be something."""
    found = torn_apart(graph, 0, RELIEF)
    assert found is not None
    return found


def test_noise_alone_is_all_there_is_on_a_perfect_map() -> None:
    found = torn(network_of(views_of()))
    both = NOISE_PX * math.sqrt(2)  # of either end
    assert found.median_px == pytest.approx(both * 1.177, rel=0.1)  # Rayleigh's median and 95 %
    assert found.p95_px == pytest.approx(both * 2.448, rel=0.1)


def test_pixels_are_those_of_the_median_frame() -> None:
    graph = network_of(views_of())
    coarser = [replace(pose, x=3 * pose.x, y=3 * pose.y, log_gsd=pose.log_gsd + math.log(3)) for pose in POSES]
    graph.put_all(range(4), coarser, 0)
    assert torn(graph).median_px == pytest.approx(NOISE_PX * math.sqrt(2) * 1.177, rel=0.1)


def test_a_frame_that_lies_elsewhere_shows() -> None:
    graph = network_of(views_of())
    graph.put(3, replace(POSES[3], x=POSES[3].x + 40), 0)
    assert torn(graph).p95_px == pytest.approx(40, rel=0.1)


def test_poses_and_relief_do_not_depend_on_what_is_held_out_to_the_bit() -> None:
    views = views_of(np.random.default_rng(5).uniform(0, 20, POINTS))
    disturbed = [view + np.where(np.arange(POINTS) % EVERY == 0, 15.0, 0.0)[:, None] for view in views]
    rough = [replace(pose, x=pose.x + 3 * number) for number, pose in enumerate(POSES)]
    one, other = network_of(views, poses=rough), network_of(disturbed, poses=rough)
    for graph in (one, other):
        adjust_island(graph, 0, AdjustmentSettings())
    assert [frame.pose for frame in one.frames] == [frame.pose for frame in other.frames]
    assert [frame.relief for frame in one.frames] == [frame.relief for frame in other.frames]
    assert one.frames[0].relief is not None
    assert one.lenses.keys() == other.lenses.keys()
    assert all(one.lenses[key].camera == other.lenses[key].camera for key in one.lenses)
    assert torn_apart(one, 0, RELIEF) != torn_apart(other, 0, RELIEF)


def test_a_feature_is_held_out_in_every_pair() -> None:
    for link in network_of(views_of()).links.values():
        assert not (link.features % EVERY == 0).any()
        assert (link.held_out % EVERY == 0).any(axis=1).all()


def test_what_stands_above_the_ground_counts_though_no_homography_accepts_it() -> None:
    tall = np.arange(POINTS) % 7 == 0
    views = views_of(np.where(tall, 60.0, 0.0))  # 7 % of the flying height
    flattered = torn(network_of([np.where(tall[:, None], np.nan, view) for view in views]))
    honest = torn(network_of(views, ~tall))
    truth = torn(network_of(views))
    assert truth.p95_px > 5 * flattered.p95_px
    assert honest.p95_px == pytest.approx(truth.p95_px, rel=0.1)
    assert honest.median_px == pytest.approx(truth.median_px, rel=0.1)


def test_false_matches_do_not_count() -> None:
    views = views_of()
    false = np.arange(POINTS) % 7 == 0
    places = np.random.default_rng(8).uniform(0, [999, 749], (len(POSES), POINTS, 2))
    mixed = [np.where(false[:, None] & np.isfinite(v), p, v) for v, p in zip(views, places, strict=True)]
    found, truth = torn(network_of(mixed, ~false)), torn(network_of(views))
    assert found.p95_px == pytest.approx(truth.p95_px, rel=0.1)


def test_nothing_is_told_of_what_few_matches_hold() -> None:
    assert torn_apart(network_of(views_of(), np.arange(POINTS) % 200 == 0), 0, RELIEF) is None
    assert torn_apart(network_of(views_of(), np.zeros(POINTS, bool)), 0, RELIEF) is None


def test_an_island_is_measured_again_when_it_has_changed_and_not_before() -> None:
    graph = network_of(views_of())
    tearing = Tearing(graph, RELIEF)
    first = tearing.of_islands()[0]
    graph.put(3, replace(POSES[3], x=POSES[3].x + 40), 0)
    assert tearing.of_islands()[0] is first
    tearing.forget(0)
    assert tearing.of_islands()[0].p95_px > 10 * first.p95_px


@pytest.mark.long
def test_the_figure_of_a_flight_is_what_its_map_really_tears_apart(ground: Image) -> None:
    """Photographs of a known ground, every frame then shifted at random: matched points show what true ones do."""
    truth = [Pose(x, y) for y in (500, 680) for x in range(400, 1200, 130)]
    mosaic = Mosaic()
    for number, pose in enumerate(truth):
        mosaic.place(seen(ground, pose, mosaic.settings.features), f"{number:02}")
    mosaic.adjust(everything=True)
    good = mosaic.held_out()[0]
    assert good.p95_px < 2
    graph, shift = mosaic._graph, np.random.default_rng(1).normal(0, 6, (len(truth), 2))
    for number, (x, y) in enumerate(shift):
        pose = graph.pose_of(number)
        graph.put(number, replace(pose, x=pose.x + x, y=pose.y + y), 0)
    found = torn(graph)
    distances = np.concatenate([true_distances(graph, truth, a, b) for a, b in graph.links])
    assert found.median_px == pytest.approx(np.median(distances), rel=0.15)
    assert found.p95_px == pytest.approx(np.quantile(distances, 0.95), rel=0.15)


def true_distances(graph: ViewGraph, truth: Sequence[Pose], a: int, b: int) -> Array:
    """How far the map tears the ground apart that two frames really share."""
    seen = pixel_grid(SMALL_CAMERA, 6, 5)
    also = pixels_from_canvas(truth[b], SMALL_CAMERA, canvas_from_pixels(truth[a], SMALL_CAMERA, seen))
    both = ((also >= 0) & (also <= [SMALL_CAMERA.width - 1, SMALL_CAMERA.height - 1])).all(axis=1)
    places = [
        canvas_from_pixels(graph.pose_of(frame), graph.camera_of(frame), pixels[both])
        for frame, pixels in ((a, seen), (b, also))
    ]
    gsd = np.median([math.exp(graph.pose_of(frame).log_gsd) for frame in range(len(truth))])
    return np.asarray(np.linalg.norm(places[0] - places[1], axis=1) / gsd)
