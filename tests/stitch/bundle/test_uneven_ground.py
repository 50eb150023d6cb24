"""Over mountains an island tells how uneven its ground is, and a new frame is held to no evener ground than that."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.island import adjust_island, resect
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pixels_from_canvas
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.union import Renamed, unite
from gcs_mosaic.stitch.graph.view_graph import Lens, ViewGraph
from gcs_mosaic.stitch.mapping.resection import PlausibilitySettings
from gcs_mosaic.stitch.registration.outcome import Registration

CAMERA = Camera(1000, 750, focal=1.4)
HEIGHT = CAMERA.focal_px  # canvas units
SETTINGS = AdjustmentSettings()
LINES, PER_LINE, POINTS = 3, 5, 1500
PLACES = [(200.0 * i, 320.0 * line) for line in range(LINES) for i in range(PER_LINE)]
NEW = len(PLACES) - 1
ALLOWED_PX = PlausibilitySettings().most_residual_px


def mountain(places: Array) -> Array:
    """Heights (n,) of a mountain three tenths as high as it is flown over, and of what lies around it."""
    off = (places - [400, 320]) / 300
    waves = np.sin(places[:, 0] / 60) * np.cos(places[:, 1] / 75)
    return np.asarray(HEIGHT * (0.3 * np.exp(-(off**2).sum(axis=1) / 2) + 0.03 * waves))


def flat(places: Array) -> Array:
    return np.zeros(len(places))


def flown(rugged: bool) -> ViewGraph:
    """A survey at its true poses, all of it linked by what its frames see in common; the newest frame is not placed yet."""
    rng = np.random.default_rng(4)
    ground = rng.uniform([-500, -400], [1300, 1050], (POINTS, 2))
    height = (mountain if rugged else flat)(ground)
    poses = [Pose(*place, 0.0, *rng.normal(0, 0.03, 3)) for place in PLACES]
    graph, views = ViewGraph(1.5, 24), [seen(pose, ground, height) + rng.normal(0, 0.3, ground.shape) for pose in poses]
    graph.found_island()
    for number, (pose, view) in enumerate(zip(poses, views, strict=True)):
        points = np.nan_to_num(view).astype(np.float32)
        graph.append(str(number), Features(points, np.zeros((POINTS, 128), np.uint8), 1000, 750, 1.0))
        if number != NEW:
            graph.put_all([number], [pose], 0, {0: Lens(CAMERA)})
    for a in range(len(poses)):
        for b in range(a):
            link(graph, a, b, views[a], views[b])
    return graph


def seen(pose: Pose, ground: Array, height: Array) -> Array:
    """Pixels (n, 2) of what stands at places (n, 2) so high (n,); NaN where they lie outside of the frame."""
    below = np.array([pose.x, pose.y])
    flying = np.exp(pose.log_gsd) * CAMERA.focal_px
    shadow = below + (ground - below) * (flying / (flying - height))[:, None]
    pixels = pixels_from_canvas(pose, CAMERA, shadow)
    inside = np.asarray(((pixels >= 0) & (pixels <= [CAMERA.width - 1, CAMERA.height - 1])).all(axis=1))
    return np.where(inside[:, None], pixels, np.nan)


def link(graph: ViewGraph, a: int, b: int, view_a: Array, view_b: Array) -> None:
    """By what agrees with one homography, as registration does; what stands far beside that plane is left out."""
    both = np.flatnonzero(np.isfinite(view_a).all(axis=1) & np.isfinite(view_b).all(axis=1))
    if len(both) < 30:
        return
    _, near = cv2.findHomography(view_a[both], view_b[both], cv2.RANSAC, 4.0)
    both = both[near.ravel() > 0]
    features = np.stack([both, both], axis=1)
    graph.link(a, b, Registration(view_a[both], view_b[both], features, np.eye(3), len(both), 99.0))


@pytest.fixture(scope="module")
def over_a_mountain() -> ViewGraph:
    graph = flown(rugged=True)
    adjust_island(graph, 0, SETTINGS)
    return graph


def residual_of_new(graph: ViewGraph) -> float:
    return resect(graph, NEW, Pose(*PLACES[NEW]), 0, SETTINGS).residual_px


@pytest.mark.long
def test_a_true_frame_over_a_mountain_fits_once_the_island_is_known_to_be_uneven(over_a_mountain: ViewGraph) -> None:
    assert over_a_mountain.unevenness[0] > SETTINGS.relief.sigma
    fits = residual_of_new(over_a_mountain)
    known = over_a_mountain.unevenness.pop(0)
    misses = residual_of_new(over_a_mountain)
    over_a_mountain.unevenness[0] = known
    assert fits < ALLOWED_PX < misses


@pytest.mark.long
def test_flat_ground_stays_as_even_as_expected() -> None:
    graph = flown(rugged=False)
    adjust_island(graph, 0, SETTINGS)
    assert graph.unevenness == {0: SETTINGS.relief.sigma}


def test_joined_islands_are_as_uneven_as_the_more_uneven() -> None:
    graph = ViewGraph(1.5, 24)
    islands = [graph.found_island() for _ in range(3)]
    graph.unevenness = {islands[0]: 0.04, islands[1]: 0.16}
    graph.merge(islands[1], islands[0])
    assert graph.unevenness == {islands[0]: 0.16}
    graph.merge(islands[0], islands[2])
    assert graph.unevenness == {islands[2]: 0.16}


def test_unevenness_is_taken_over_from_another_flight() -> None:
    graph, other = ViewGraph(1.5, 24), ViewGraph(1.5, 24)
    graph.found_island()
    other.unevenness[other.found_island()] = 0.08
    unite(graph, other, Renamed(lambda name: name, lambda aircraft: aircraft))
    assert graph.unevenness == {1: 0.08}
