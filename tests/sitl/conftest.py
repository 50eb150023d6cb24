"""One painted world and a small camera for all tests of the simulated flight."""

from __future__ import annotations

import pytest

from sitl.camera import Camera, Scene
from sitl.flight import Flight, plan
from sitl.geometry import Lens
from sitl.path import Plan
from sitl.world import World, make_world


@pytest.fixture(scope="session")
def world() -> World:
    """A small world of 205 m."""
    return make_world(seed=3, size=2048)


@pytest.fixture(scope="session")
def scene(world: World) -> Scene:
    """A camera of 640x480 over flat ground; noise as it comes."""
    return Scene(world=world, camera=Camera(lens=Lens(width=640, height=480)))


@pytest.fixture(scope="session")
def flight() -> Flight:
    """Twelve small frames of a level survey that fit the small world."""
    return plan("survey", (640, 480), seed=3, world_size=2048, route=Plan(frames=12, height=60))
