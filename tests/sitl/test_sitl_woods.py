"""A wood in the wind: its gaps show the ground, its crowns have heights and sway, the ground stands still."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sitl.camera import Camera, Scene
from sitl.geometry import CameraState, Lens, pixels_from_ground, rays_of_picture
from sitl.ground.woods import TALLEST, raise_woods
from sitl.leaves import leaf_out
from sitl.wind import still_place
from sitl.world import WOODS, World, make_world

ABOVE = CameraState(time=0, x=-4, y=5, height=90, yaw=0.1, pitch=0.03)
LATER = replace(ABOVE, time=7.3)
ASIDE = replace(ABOVE, x=16, time=4.1)


@pytest.fixture(scope="module")
def wood() -> World:
    """102 m of it."""
    return make_world.__wrapped__(2, 1024, ground=WOODS)


@pytest.fixture(scope="module")
def over(wood: World) -> Scene:
    """A noiseless camera that sees 86 x 65 m of it."""
    return Scene(world=wood, camera=Camera(lens=Lens(width=320, height=240), noise=0), relief=1.0)


def heights_seen(scene: Scene, state: CameraState) -> np.ndarray:
    return scene.seen(state, rays_of_picture(scene.camera.lens))[2]


def test_the_same_seed_grows_the_same_wood() -> None:
    first, again = (raise_woods(1, 512, 0.1) for _ in range(2))
    assert np.array_equal(first.heights, again.heights)
    assert np.array_equal(first.owner, again.owner)


def test_crowns_are_high_and_close_but_for_gaps(wood: World, over: Scene) -> None:
    leafy = wood.heights > 0
    assert 0.05 < 1 - leafy.mean() < 0.35
    assert 0.03 < (heights_seen(over, ABOVE) < 0.3).mean() < 0.25
    assert 10 < np.median(wood.heights[leafy]) < 18
    assert wood.heights.max() <= TALLEST


@pytest.mark.long
def test_wind_moves_crowns_and_not_the_ground(over: Scene) -> None:
    before, after = (over.light(state) for state in (ABOVE, LATER))
    low = (heights_seen(over, ABOVE) < 0.1) & (heights_seen(over, LATER) < 0.1)
    high = (heights_seen(over, ABOVE) > 12) & (heights_seen(over, LATER) > 12)
    assert low.sum() > 1000
    assert np.abs(before - after)[low].max() < 1
    assert np.median(np.abs(before - after)[high]) > 8


def test_nothing_moves_in_still_air(over: Scene) -> None:
    calm = replace(over, sway=0.0)
    assert np.array_equal(calm.light(ABOVE), calm.light(LATER))


def test_every_crown_sways_by_its_own_and_steadily(wood: World) -> None:
    assert wood.wind is not None
    now, again, soon, later = (wood.wind.sway(time) for time in (5.0, 5.0, 5.02, 9.0))
    assert np.array_equal(now, again)
    assert np.abs(soon - now).max() < 0.3
    assert np.abs(later - now).mean() > 0.5
    assert 0.5 < np.hypot(*np.moveaxis(now, -1, 0)).mean() < 1.8
    tops = [now[wood.wind.owner == number].mean(0) for number in range(1, 200)]
    assert np.nanstd(tops, axis=0).max() > 0.5


def test_sway_grows_with_the_height() -> None:
    sway = np.full((4, 4, 2), (0.6, -0.2), np.float32)
    x = y = np.zeros((1, 3))
    at = np.ones((1, 3), np.float32)
    east, south = still_place(sway, x, y, np.array([[0, TALLEST / 2, TALLEST]]), at, at)
    np.testing.assert_allclose(east, [[0, -0.15, -0.6]], atol=1e-6)
    np.testing.assert_allclose(south, [[0, 0.05, 0.2]], atol=1e-6)


@pytest.mark.parametrize("state", [ABOVE, ASIDE])
def test_what_is_high_is_seen_where_its_height_puts_it(over: Scene, state: CameraState) -> None:
    calm = replace(over, sway=0.0)
    pixels = np.array([[x, y] for x in range(20, 310, 30) for y in range(20, 230, 30)], np.float64)
    x, y, height = (found[pixels[:, 1].astype(int), pixels[:, 0].astype(int)] for found in calm.seen(state, rays(calm)))
    back = pixels_from_ground(calm.camera.lens, state, np.stack([x, y], axis=1), height)
    assert height.max() > 10
    assert np.abs(back - pixels).max() < 0.05


def rays(scene: Scene) -> np.ndarray:
    return rays_of_picture(scene.camera.lens)


def test_leaves_are_on_all_sides_of_a_crown_and_not_on_the_ground() -> None:
    x = y = np.zeros((1, 200))
    height = np.linspace(0, 20, 200)[None]
    colours = np.full((1, 200, 3), 100, np.float32)
    leaf_out(colours, (x, y, height), 0.5, octave=0.0)
    assert (colours[height <= 0.5] == 100).all()
    assert colours[height > 0.5].std() > 15


def test_a_kept_wood_is_the_painted_one(tmp_path: Path) -> None:
    kept, reread = (make_world.__wrapped__(5, 512, cache=tmp_path, ground=WOODS) for _ in range(2))
    assert kept.sheer
    assert reread.wind is not None
    assert kept.wind is not None
    assert np.array_equal(kept.wind.sway(3.0), reread.wind.sway(3.0))
