"""Frames over a hill: what they see twice is brought together, over the place where it stands."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.matched_points import Sightings, matched, sightings
from gcs_mosaic.stitch.bundle.relief import displacements, note_relief
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixels_from_canvas
from gcs_mosaic.stitch.camera.relief import ReliefSettings, on_plane
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.view_graph import Lens, ViewGraph
from gcs_mosaic.stitch.registration.outcome import Registration

CAMERA = Camera(1000, 750, focal=1.3, k1=-0.05)
POSES = [Pose(x, y, 0.0, yaw) for x, y, yaw in ((0, 0, 0.1), (350, 20, 0), (-20, 300, 3), (330, 280, -0.2))]
SCALE = 1.0


def hill(places: Array) -> Array:
    """Heights (n,) above the plane, up to 3 % of the flying height."""
    return np.asarray(30 * np.exp(-((places - [150, 150]) ** 2).sum(axis=1) / 220**2))


def seen(pose: Pose, ground: Array) -> Array:
    """Pixels (n, 2) of what stands at places (n, 2); NaN where they lie outside of the frame."""
    height = np.exp(pose.log_gsd) * CAMERA.focal_px
    below = np.array([pose.x, pose.y])
    shadow = below + (ground - below) * (height / (height - hill(ground)))[:, None]
    pixels = pixels_from_canvas(pose, CAMERA, shadow)
    inside = np.asarray(((pixels >= 0) & (pixels <= [CAMERA.width - 1, CAMERA.height - 1])).all(axis=1))
    return np.where(inside[:, None], pixels, np.nan)


@pytest.fixture
def graph() -> ViewGraph:
    return flown(900)


def flown(count: int) -> ViewGraph:
    """Four frames at their true poses, linked by what they see of so many points, half a pixel off."""
    noise = np.random.default_rng(2)
    ground = noise.uniform([-600, -500], [1000, 900], (count, 2))
    views = [seen(pose, ground) + noise.normal(0, 0.5, ground.shape) for pose in POSES]
    graph = ViewGraph(1.5, 24)
    for number, (pose, view) in enumerate(zip(POSES, views, strict=True)):
        points = np.nan_to_num(view).astype(np.float32)
        graph.append(str(number), Features(points, np.zeros((count, 128), np.uint8), 1000, 750, SCALE))
        graph.put_all([number], [pose], 0, {0: Lens(CAMERA)})
    for a in range(4):
        for b in range(a):
            both = np.flatnonzero(np.isfinite(views[a]).all(axis=1) & np.isfinite(views[b]).all(axis=1))
            features = np.stack([both, both], axis=1)
            graph.link(a, b, Registration(views[a][both], views[b][both], features, np.eye(3), len(both), 99.0))
    return graph


def ortho_errors(graph: ViewGraph, frames: Sequence[int] = range(4)) -> Array:
    """How far the frames put points of the ground from where they stand, over what two frames see."""
    check = np.random.default_rng(3).uniform([-100, -100], [450, 400], (400, 2))
    errors = []
    for number in frames:
        pose = POSES[number]
        pixels = seen(pose, check)
        inside = np.isfinite(pixels).all(axis=1)
        places = canvas_from_pixels(pose, CAMERA, on_plane(graph.frames[number].relief, CAMERA, pixels[inside]))
        errors.append(np.linalg.norm(places - check[inside], axis=1))
    return np.concatenate(errors)


def grid_of(graph: ViewGraph, frame: int) -> NDArray[np.float32]:
    relief = graph.frames[frame].relief
    assert relief is not None
    return relief.grid


def note_all(graph: ViewGraph) -> None:
    views = [(pose, CAMERA) for pose in POSES]
    matches = matched(graph, range(4))
    assert matches is not None
    found = displacements(sightings(matches), views, ReliefSettings())
    for frame, relief in enumerate(found):
        graph.note(frame, relief=relief)


def test_a_hill_is_taken_out_of_the_frames(graph: ViewGraph) -> None:
    before = ortho_errors(graph)
    note_all(graph)
    after = ortho_errors(graph)
    assert np.median(before) > 2
    assert np.median(after) < 0.25 * np.median(before)
    assert np.quantile(after, 0.95) < 0.35 * np.quantile(before, 0.95)


def test_one_frame_alone_is_shifted_onto_what_all_have_seen(graph: ViewGraph) -> None:
    note_all(graph)
    together = grid_of(graph, 2)
    note_relief(graph, 2, ReliefSettings())
    assert np.abs(grid_of(graph, 2) - together).max() * CAMERA.half_diagonal < 1.5
    assert np.abs(together).max() * CAMERA.half_diagonal > 4


def test_without_cells_every_frame_stays_a_camera_over_a_plane(graph: ViewGraph) -> None:
    note_relief(graph, 0, ReliefSettings(cells=0))
    assert graph.frames[0].relief is None


def test_a_hill_that_a_frame_was_not_matched_on_is_known_from_those_around() -> None:
    graph = flown(5000)
    matches = matched(graph, range(4))
    assert matches is not None
    all_seen = sightings(matches)
    on_hill = np.linalg.norm(canvas_from_pixels(POSES[2], CAMERA, all_seen.pixels) - [150, 150], axis=1) < 180
    kept = (all_seen.row != 2) | ~on_hill
    seen_by_others = Sightings(all_seen.row[kept], all_seen.pixels[kept], all_seen.point[kept], all_seen.scales)
    before = ortho_errors(graph, [2])
    for frame, relief in enumerate(displacements(seen_by_others, [(pose, CAMERA) for pose in POSES], ReliefSettings())):
        graph.note(frame, relief=relief)
    assert np.quantile(ortho_errors(graph, [2]), 0.95) < 0.25 * np.quantile(before, 0.95)


def test_a_lone_frame_has_no_relief() -> None:
    graph = ViewGraph(1.5, 24)
    graph.append("a", Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8), 1000, 750, 1.0))
    graph.put(0, POSES[0], 0)
    note_relief(graph, 0, ReliefSettings())
    assert graph.frames[0].relief is None
