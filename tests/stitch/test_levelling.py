"""Straight flights at one height and heading: nothing but the model says that they are level, and the map must not wander.

The matches of such a flight leave the common tilt nearly open (and focal length and lens along one line): it is held by weak
priors. Frames count as drawn where they lie and are drawn again when a corner has moved by more than a pixel, as the
painter does.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from stitch_ground import Image, textured_ground

from gcs_mosaic.stitch.bundle import island
from gcs_mosaic.stitch.bundle.point_adjustment import Grounded, grounded
from gcs_mosaic.stitch.camera.geometry import (
    Camera,
    Pose,
    canvas_from_pixels,
    frame_border,
    pixel_grid,
    pixels_from_canvas,
)
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic

pytestmark = pytest.mark.long


BARREL = Camera(480, 360, 1.45, -0.1)
PINHOLE = Camera(480, 360, 1.45, 0.0)
REPAINT_PX = 1.0
SIDE = 2800  # of the ground

Heights = NDArray[np.float32]


def strip(count: int = 24, step: float = 95) -> list[Pose]:
    """One line."""
    return [Pose(280 + step * i, 300) for i in range(count)]


def lawn(lines: int = 3, per_line: int = 8, step: float = 120, spacing: float = 200) -> list[Pose]:
    """Lines to and fro without turning: sideways and backwards."""
    along = [np.arange(per_line), np.arange(per_line)[::-1]]
    return [Pose(280 + step * i, 300 + spacing * k) for k in range(lines) for i in along[k % 2]]


@pytest.fixture(scope="module")
def ground() -> Image:
    return textured_ground(SIDE, seed=3)


@pytest.fixture(scope="module")
def hills() -> Heights:
    """Heights (SIDE, SIDE), deviation 1, that change within half a frame."""
    coarse = np.random.default_rng(6).normal(size=(SIDE // 200 + 2,) * 2).astype(np.float32)
    fine = cv2.resize(coarse, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    return np.asarray((fine - fine.mean()) / fine.std(), np.float32)


def at(values: NDArray[Any], places: NDArray[np.float32], camera: Camera, beyond: int = 0) -> NDArray[Any]:
    """What lies at these places (h * w, 2), a picture of the camera's size."""
    maps = places.reshape(camera.height, camera.width, 2)
    return np.asarray(cv2.remap(values, maps, None, cv2.INTER_LINEAR, borderValue=beyond))  # type: ignore[call-overload]


def photograph(ground: Image, heights: Heights, pose: Pose, camera: Camera) -> Image:
    """What the camera sees of ground that rises and falls: sight lines are followed to it in a few steps."""
    level = canvas_from_pixels(pose, camera, pixel_grid(camera, camera.width, camera.height)).astype(np.float32)
    below, places = np.array([pose.x, pose.y], np.float32), level
    for _ in range(4 * bool(heights.any())):
        rise = at(heights, places, camera)
        places = np.asarray(level - (level - below) * (rise / camera.focal_px).reshape(-1, 1), np.float32)
    return np.asarray(at(ground, places, camera, beyond=128), np.uint8)


def displacement(drawn: Placement, placement: Placement) -> float:
    """How far the worst corner of a frame has moved since it was drawn, its own pixels."""
    corners = frame_border(placement.camera, 1)
    places = canvas_from_pixels(drawn.pose, drawn.camera, corners)
    moved = pixels_from_canvas(placement.pose, placement.camera, places) - corners
    return float(np.linalg.norm(moved, axis=1).max())


def flown(views: Iterable[Image]) -> tuple[list[Placement], list[int]]:
    """The mosaic after the flight, and how many frames had to be drawn again after each frame."""
    mosaic = Mosaic()
    again: list[int] = []
    drawn: dict[str, Placement] = {}
    for i, view in enumerate(views):
        mosaic.add(view, f"{i:03}")
        mosaic.adjust()
        moved = mosaic.moved()
        stale = [p for p in moved if p.name in drawn and displacement(drawn[p.name], p) > REPAINT_PX]
        for placement in [*stale, *(p for p in moved if p.name not in drawn)]:
            drawn[placement.name] = placement
            mosaic.anchor_drawn_pose(placement.name, placement.pose, placement.camera)
        again.append(len(stale))
    return mosaic.placements(), again


@pytest.mark.thorough
@pytest.mark.parametrize(
    "camera", [pytest.param(PINHOLE, marks=pytest.mark.thorough), BARREL], ids=["pinhole", "barrel"]
)
@pytest.mark.parametrize("route", [pytest.param(strip, marks=pytest.mark.thorough), lawn])
def test_over_flat_ground_the_map_stays_where_it_is_and_ends_level(
    ground: Image, route: Callable[[], list[Pose]], camera: Camera
) -> None:
    flat, poses = np.zeros((SIDE, SIDE), np.float32), route()
    placements, again = flown(photograph(ground, flat, pose, camera) for pose in poses)
    assert {p.island for p in placements} == {0}
    assert len(placements) == len(poses)
    assert sum(again[len(again) // 2 :]) <= 2
    assert steepest(placements) < 0.3
    assert spread_of_scales(placements) < 0.005


@pytest.mark.thorough
@pytest.mark.parametrize("route", [pytest.param(strip, marks=pytest.mark.thorough), lawn])
def test_over_hills_it_neither_tilts_nor_grows(
    ground: Image, hills: Heights, route: Callable[[], list[Pose]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heights with a deviation of 1.5 % of the flying height. That they shift frames by pixels is true and may be. Its cameras
    stay level; a frame is drawn over a slope much as one that is tilted, but none leans more than the steepest ground."""
    over_points: list[Grounded] = []
    monkeypatch.setattr(island, "grounded", lambda *task: noted(over_points, grounded(*task)))
    heights, poses = (0.015 * PINHOLE.focal_px * hills).astype(np.float32), route()
    placements, _ = flown(photograph(ground, heights, pose, PINHOLE) for pose in poses)
    assert {p.island for p in placements} == {0}
    assert len(placements) == len(poses)
    cameras = over_points[-1].poses
    assert 9 * len(cameras) >= 8 * len(poses)  # an island is adjusted whenever it has grown by an eighth
    assert max(np.degrees(np.hypot(cameras[:, 4], cameras[:, 5]))) < 1.5
    assert steepest(placements) < max(slope(heights, pose) for pose in poses)
    assert spread_of_scales(placements) < 0.05


def noted(kept: list[Grounded], found: Grounded | None) -> Grounded | None:
    kept += [] if found is None else [found]
    return found


def steepest(placements: Iterable[Placement]) -> float:
    """Largest tilt, degrees."""
    return max(math.degrees(math.hypot(p.pose.pitch, p.pose.roll)) for p in placements)


def slope(heights: Heights, pose: Pose) -> float:
    """Of the plane that fits the ground best that a level frame shows, degrees."""
    x, y = round(pose.x) - PINHOLE.width // 2, round(pose.y) - PINHOLE.height // 2
    shown = heights[y : y + PINHOLE.height, x : x + PINHOLE.width]
    row, column = np.indices(shown.shape)
    plane = np.stack([column.ravel(), row.ravel(), np.ones(shown.size)], axis=1)
    along_x, along_y, _ = np.linalg.lstsq(plane, shown.ravel(), rcond=None)[0]
    return math.degrees(math.hypot(along_x, along_y))


def spread_of_scales(placements: Iterable[Placement]) -> float:
    """Largest ratio of two frames' ground resolutions, less one."""
    return math.exp(np.ptp([p.pose.log_gsd for p in placements])) - 1
