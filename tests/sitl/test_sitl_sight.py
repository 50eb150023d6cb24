"""What stands tall hides what is behind it, waves do not stay, and a thermal camera's pattern does."""

import numpy as np
import pytest

from sitl.flight import plan
from sitl.geometry import CameraState
from sitl.path import Plan
from sitl.sight import first_met
from sitl.thermal import ThermalCamera

WALL_EAST, WALL_WIDE, WALL_HIGH = 10.0, 4.0, 12.0
ROUTE = Plan(frames=4, height=60)


def wall(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A wall that runs north and south."""
    return np.asarray(np.where(abs(x - WALL_EAST - WALL_WIDE / 2) < WALL_WIDE / 2, WALL_HIGH, 0.0) + 0 * y)


@pytest.mark.parametrize(
    ("ground", "seen"),
    [(5.0, 5.0), (15.0, 15.0 * 28 / 40), (19.0, 19.0 * 28 / 40), (30.0, 30.0)],
    ids=["before the wall", "its top", "hidden behind it", "beyond"],
)
def test_a_view_ends_at_the_first_thing_it_meets(ground: float, seen: float) -> None:
    """From 40 m above the origin, along the view that would end at `ground` on the plane."""
    state = CameraState(time=0, x=0, y=0, height=40)
    x, _, _ = first_met(state, np.array([[[ground / 40, 0.0]]]), wall, WALL_HIGH)
    assert x.item() == pytest.approx(seen, abs=0.1)


@pytest.mark.long
def test_relief_displaces_crowns_and_leaves_the_truth_right() -> None:
    flight = plan("survey", (320, 240), ground="orchard", relief=1.0, world_size=2048, route=ROUTE)
    pixels = np.stack(np.meshgrid(np.arange(20, 300, 20.0), np.arange(20, 220, 20.0)), -1).reshape(-1, 2)
    ground = flight.scene.ground_from_pixels(flight.states[0], pixels)
    back = flight.scene.pixels_from_ground(flight.states[0], ground)
    assert np.median(np.linalg.norm(back - pixels, axis=1)) < 0.5
    flat = plan("survey", (320, 240), ground="orchard", world_size=2048, route=ROUTE).scene
    assert np.linalg.norm(flat.ground_from_pixels(flight.states[0], pixels) - ground, axis=1).max() > 2


@pytest.mark.long
def test_water_is_another_in_every_frame_and_land_is_not() -> None:
    flight = plan("survey", (320, 240), ground="lake", world_size=2048, route=ROUTE)
    state, scene = flight.states[0], flight.scene
    later = CameraState(time=9.0, x=state.x, y=state.y, height=60, yaw=state.yaw)
    first, again = (
        scene.light(s) for s in (CameraState(time=0.0, x=state.x, y=state.y, height=60, yaw=state.yaw), later)
    )
    changed = abs(first - again).max(axis=2) > 1
    assert 0.02 < changed.mean() < 0.98
    assert np.array_equal(scene.light(later), again)


def test_the_pattern_of_a_thermal_camera_stays() -> None:
    camera, rng = ThermalCamera(noise=0), np.random.default_rng(1)
    pictures = [camera.picture(rng.integers(0, 255, (120, 160, 3)).astype(np.uint8), k) for k in range(2)]
    still = camera.pattern((160, 120))
    assert np.array_equal(still, camera.pattern((160, 120)))
    assert np.corrcoef(pictures[0].ravel(), pictures[1].ravel())[0, 1] > 0.5
