"""Flights that invite false joins: ground that repeats itself, look-alikes, writing in the picture, two flights in one folder.

A frame may wait for ever; it must never lie where it was not taken. `tests/benchmarks/strangers.py` does it at length.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.geometry import canvas_from_pixels, pixel_grid, similarity_between
from gcs_mosaic.stitch.matching.features import Features, FeatureSettings, extract
from gcs_mosaic.stitch.mosaic import Mosaic, Placement
from sitl.flight import plan
from sitl.geometry import ground_from_pixels
from sitl.path import Plan

SIZE = (640, 480)
SHARED = Path(__file__).parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Shot:
    """A frame and its truth: the world it was taken over, and where a grid of its pixels lies there, in metres."""

    name: str
    features: Features
    world: str
    ground: np.ndarray | None


def shots(ground: str, seed: int, *, scenario="survey", written=False, **route) -> list[Shot]:
    """The frames of a simulated flight; `written`: height and time are burnt into each."""
    flight = plan(scenario, SIZE, seed=seed, ground=ground, world_size=2048, route=Plan(**({"height": 60} | route)))
    grid = pixel_grid_of(SIZE)
    taken = []
    for k, state in enumerate(flight.states):
        image = flight.scene.picture(state, k).copy()
        if written:
            for line in range(3):
                at = (20, 40 + 190 * line)
                cv2.putText(image, f"ALT 60.{line} HDG 27{line}", at, cv2.FONT_HERSHEY_SIMPLEX, 1.2, (255,) * 3, 2)
        where = np.asarray(ground_from_pixels(flight.scene.camera.lens, state, grid), float)
        taken.append(Shot(f"{ground}{seed}-{k:03}", extract(image, FeatureSettings()), f"{ground}{seed}", where))
    return taken


def pixel_grid_of(size: tuple[int, int]) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, 5), np.linspace(0, size[1] - 1, 4))
    return np.column_stack([x.ravel(), y.ravel()])


def in_turn(*flights: list[Shot]) -> list[Shot]:
    """One frame of each flight after the other."""
    return [shot for together in zip(*flights, strict=True) for shot in together]


def stitched(taken: list[Shot]) -> Mosaic:
    mosaic = Mosaic()
    for shot in taken:
        mosaic.place(shot.features, shot.name)
        mosaic.adjust()
    mosaic.retry_waiting()
    mosaic.adjust(everything=True)
    return mosaic


def islands_of(mosaic: Mosaic) -> list[list[Placement]]:
    """Placements by island, the largest first."""
    islands: dict[int, list[Placement]] = {}
    for placement in mosaic.placements():
        islands.setdefault(placement.island, []).append(placement)
    return sorted(islands.values(), key=len, reverse=True)


def assert_nothing_is_mixed_up(mosaic: Mosaic, taken: list[Shot]) -> None:
    """Every island shows one world, and every frame of it lies where it was taken, within a hundredth of its width."""
    truth = {shot.name: shot for shot in taken}
    for island in islands_of(mosaic):
        assert len({truth[placement.name].world for placement in island}) == 1
        if all(truth[placement.name].ground is not None for placement in island):
            assert worst_error_px(island, truth) < 0.01 * SIZE[0]


def worst_error_px(island: list[Placement], truth: dict[str, Shot]) -> float:
    """Of any frame: RMS distance of its pixels from their true places after one similarity of the island."""
    found = np.array([canvas_from_pixels(p.pose, p.camera, pixel_grid(p.camera, 5, 4)) for p in island])
    true = np.array([truth[p.name].ground for p in island])
    scale, angle, shift = similarity_between(true.reshape(-1, 2), found.reshape(-1, 2))
    c, s = math.cos(angle), math.sin(angle)
    off = scale * true @ np.array([[c, s], [-s, c]]) + shift - found
    return float(np.sqrt((off**2).sum(axis=2).mean(axis=1)).max())


@pytest.mark.parametrize("ground", ["rows", "cars"])
def test_ground_that_repeats_itself_misplaces_nothing(ground):
    taken = in_turn(*(shots(ground, seed, frames=6) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert len(mosaic.placements()) >= 10


def test_halls_of_one_make_join_no_two_places():
    taken = in_turn(*(shots("halls", seed, frames=7) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert [len(island) for island in islands_of(mosaic)] == [7, 7]


def test_writing_in_every_picture_joins_no_two_places():
    taken = in_turn(*(shots("country", seed, frames=6, written=True) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert len(mosaic.placements()) >= 10


def test_waves_that_have_moved_on_are_nowhere():
    """Out over the water and back: each picture of water shows other waves."""
    shore = shots("country", 1, frames=5)
    water = [shots("water", seed, frames=1)[0] for seed in range(2, 8)]
    mosaic = stitched([*shore[:3], *water, *shore[3:]])
    assert {placement.name for placement in mosaic.placements()} == {shot.name for shot in shore}
    assert_nothing_is_mixed_up(mosaic, [*shore, *water])


def test_a_second_visit_after_a_long_absence_closes_the_map():
    """Away over other land for longer than anything is near, then over the first ground again, from elsewhere."""
    first, again = shots("country", 1, frames=4), shots("country", 1, frames=9)[4:]
    taken = [*first, *shots("country", 2, frames=7), *again]
    taken = [Shot(f"{i:03}", shot.features, shot.world, shot.ground) for i, shot in enumerate(taken)]
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert [len(island) for island in islands_of(mosaic)] == [9, 7]


@pytest.mark.skipif(not SHARED.is_dir(), reason="the recorded flights are not beside the project")
def test_two_recorded_flights_in_one_folder_stay_apart():
    flights = [recorded(name) for name in ("caliterra", "copr")]
    taken = in_turn(*flights)
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert [len(island) for island in islands_of(mosaic)] == [6, 6]


def recorded(flight: str, count: int = 6) -> list[Shot]:
    """The first photographs of a recorded flight, read at a quarter of their size; no truth is needed of them."""
    paths = sorted((SHARED / flight).glob("*.[jJ][pP]*"))[:count]
    images = (cv2.imread(str(path), cv2.IMREAD_REDUCED_COLOR_4) for path in paths)
    return [
        Shot(path.name, extract(image, FeatureSettings(), 4), flight, None)
        for path, image in zip(paths, images, strict=True)
    ]
