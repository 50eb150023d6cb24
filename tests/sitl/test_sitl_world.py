from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from sitl.ground.heights import HIGHEST_HILL
from sitl.ground.noise import fractal
from sitl.world import World, make_world, mirrored


def centres(world: World, count: int, level: int = 0) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Metres of the centres of the first pixels of a level along one side."""
    return np.asarray((np.arange(count) + 0.5) * world.gsd * 2**level - world.side / 2)


def test_the_same_seed_paints_the_same_ground_and_another_another() -> None:
    first, again, other = (make_world.__wrapped__(seed, 512) for seed in (1, 1, 2))
    assert np.array_equal(first.levels[0], again.levels[0])
    assert np.array_equal(first.heights, again.heights)
    assert not np.array_equal(first.levels[0], other.levels[0])


def test_a_kept_world_is_the_painted_one(tmp_path: Path) -> None:
    painted, kept = make_world.__wrapped__(5, 512), make_world.__wrapped__(5, 512, cache=tmp_path)
    reread = make_world.__wrapped__(5, 512, cache=tmp_path)
    for world in (kept, reread):
        assert all(np.array_equal(a, b) for a, b in zip(world.levels, painted.levels, strict=True))
        assert np.array_equal(world.heights, painted.heights)
    assert len(list(tmp_path.iterdir())) == 1


def test_every_scale_has_marks_to_find(world: World) -> None:
    sift = cv2.SIFT.create()
    for level in world.levels[:4]:
        middle = len(level) // 2
        found = sift.detect(np.ascontiguousarray(level[middle - 128 : middle + 128, middle - 128 : middle + 128]))
        assert len(found) > 150


def test_there_is_soil_grass_and_shadow(world: World) -> None:
    b, g, r = (np.asarray(world.levels[2], np.int32)[..., k] for k in range(3))
    assert ((r > g) & (g > b)).mean() > 0.2, "soil and ripe crops"
    assert ((g > r) & (g > b)).mean() > 0.1, "green"
    assert 0.005 < (r + g + b < 120).mean() < 0.3, "shadows and woods, not night"


def test_a_place_has_the_colour_of_its_pixel(world: World) -> None:
    x, y = np.meshgrid(centres(world, 20), centres(world, 12))
    colours = world.colours(x, y, octave=np.zeros_like(x))
    assert np.allclose(colours, world.levels[0][:12, :20], atol=1)


def test_a_coarse_view_takes_the_coarse_level(world: World) -> None:
    x, y = np.meshgrid(centres(world, 20, level=2), centres(world, 12, level=2))
    assert np.allclose(world.colours(x, y, octave=np.full_like(x, 2.0)), world.levels[2][:12, :20], atol=1)
    between = world.colours(x, y, octave=np.full_like(x, 1.5))
    ends = [world.colours(x, y, octave=np.full_like(x, octave)) for octave in (1.0, 2.0)]
    assert np.allclose(between, (ends[0] + ends[1]) / 2, atol=1)


def test_nothing_is_black(world: World) -> None:
    x = np.array([[np.nan, 0.0]])
    colours = world.colours(x, np.zeros_like(x), octave=np.array([[np.nan, 0.0]]))
    assert (colours[0, 0] == 0).all()
    assert (colours[0, 1] > 0).all()


def test_outside_the_ground_is_mirrored_and_not_contained(world: World) -> None:
    edge = world.side / 2
    assert np.allclose(
        mirrored(np.array([-513.0, 511.0, 513.0]), 1024), mirrored(np.array([-511.0, 511.0, 511.0]), 1024)
    )
    places = np.array([[0.0, 0.0], [edge + 1, 0], [0, -edge - 1], [np.nan, 0]])
    assert world.contains(places).tolist() == [True, False, False, False]


def test_heights_are_hills_with_things_on_them(world: World) -> None:
    assert world.heights.min() >= 0
    assert HIGHEST_HILL * 1.1 < world.heights.max() < 25
    x = y = centres(world, 8) * 0 + world.side / len(world.heights) * 0.5
    row = column = len(world.heights) // 2
    assert np.allclose(world.height_at(x, y), world.heights[row, column], atol=1e-3)
    assert np.allclose(world.height_at(x, y, relief=0.5), world.heights[row, column] / 2, atol=1e-3)


def test_noise_has_equal_strength_in_every_octave() -> None:
    field = fractal(np.random.default_rng(1), 1024, coarsest=64)
    blurred = [field, *(cv2.GaussianBlur(field, (0, 0), sigma) for sigma in (1, 2, 4, 8))]
    bands = [float(np.std(fine - coarse)) for fine, coarse in pairwise(blurred[1:])]
    assert abs(field.mean()) < 1e-3
    assert abs(field.std() - 1) < 1e-3
    assert max(bands) < 2 * min(bands)
    assert np.std(field - blurred[1]) > 1.5 * max(bands), "and down to the finest pixel"
