"""Flights that invite false joins, with what is true of every frame: for tests and benchmarks."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypedDict, Unpack

import cv2
import numpy as np
from stitch_ground import Image

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, pixel_grid, similarity_between
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.flight import plan
from sitl.geometry import HeightAt, ground_from_pixels
from sitl.path import Plan
from tests.benchmarks.recorded import photographs, read

SIZE = (640, 480)


class Route(TypedDict, total=False):
    """What tests choose of a sitl.path.Plan."""

    frames: int
    height: float
    forward: float
    side: float


ONE_LINE: Route = {"frames": 9, "side": -0.3}  # lines so far apart that a short survey is one
PLANES = 5  # heights between the ground and the tallest thing: which of them a map takes for its own is its affair


@dataclass(frozen=True)
class Shot:
    """A frame and its truth: the world it was taken over, and where a grid of its pixels lies there, in metres.

    ground: (planes, n, 2), the grid on planes at some heights from the ground to the top of what stands on it.
    """

    name: str
    features: Features
    world: str
    ground: Array | None


def shots(
    ground: str,
    seed: int,
    *,
    scenario: str = "survey",
    relief: float = 0.0,
    seen: Callable[[Image, int], Image] = lambda image, index: image,
    **route: Unpack[Route],
) -> list[Shot]:
    """The frames of a simulated flight; `seen`: what becomes of the picture with this index before anyone looks at it."""
    planned = Plan(**Route(height=60) | route)
    flight = plan(scenario, SIZE, seed=seed, ground=ground, relief=relief, world_size=2048, route=planned)
    grid, lens = pixel_grid_of(SIZE), flight.scene.camera.lens
    planes = np.linspace(0, relief * flight.scene.world.heights.max(), PLANES if relief else 1)
    taken = []
    for k, state in enumerate(flight.states):
        image = seen(flight.scene.picture(state, k), k)
        where = [ground_from_pixels(lens, state, grid, level_at(z)) for z in planes]
        name, world = f"{ground}{seed}-{k:03}", f"{ground}{seed}"
        taken.append(Shot(name, extract(image, FeatureSettings()), world, np.asarray(where, float)))
    return taken


def level_at(height: float) -> HeightAt:
    """Heights of a plane."""
    return lambda x, y: np.full_like(x, height)


def written_on(image: Image, index: int) -> Image:
    """The picture with height and heading burnt in."""
    image = image.copy()
    for line in range(3):
        at = (20, 40 + 190 * line)
        cv2.putText(image, f"ALT 60.{line} HDG 27{line}", at, cv2.FONT_HERSHEY_SIMPLEX, 1.2, (255,) * 3, 2)
    return image


def pixel_grid_of(size: tuple[int, int]) -> Array:
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, 5), np.linspace(0, size[1] - 1, 4))
    return np.column_stack([x.ravel(), y.ravel()])


def recorded(flight: str, count: int = 6) -> list[Shot]:
    """The first photographs of a recorded flight; no truth is needed of them."""
    return [Shot(path.name, read(path), flight, None) for path in photographs(flight)[:count]]


def in_turn(*flights: list[Shot]) -> list[Shot]:
    """One frame of each flight after the other."""
    return [shot for together in zip(*flights, strict=True) for shot in together]


def with_a_gap(line: list[Shot]) -> list[Shot]:
    """The two ends of ONE_LINE at the usual overlap: they have no ground in common."""
    return line[:3] + line[6:]


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


@dataclass(frozen=True)
class Outcome:
    """What became of a flight. islands: frames of each, the largest first; mixed: how many show more than one world; worst_px:
    of any frame, how far its pixels lie from where they should, 0 where no truth is known."""

    frames: int
    islands: tuple[int, ...]
    mixed: int
    worst_px: float

    @property
    def placed(self) -> int:
        return sum(self.islands)


def outcome(mosaic: Mosaic, taken: list[Shot]) -> Outcome:
    truth = {shot.name: shot for shot in taken}
    islands = islands_of(mosaic)
    pure = [island for island in islands if len({truth[p.name].world for p in island}) == 1]
    known = [island for island in pure if all(truth[p.name].ground is not None for p in island)]
    worst = max((worst_error_px(island, truth) for island in known), default=0.0)
    return Outcome(len(taken), tuple(map(len, islands)), len(islands) - len(pure), worst)


def assert_nothing_is_mixed_up(mosaic: Mosaic, taken: list[Shot], within: float = 0.01) -> Outcome:
    """Every island shows one world, and every frame of it lies where it was taken, `within` a share of its width."""
    result = outcome(mosaic, taken)
    assert result.mixed == 0, result
    assert result.worst_px < within * SIZE[0], result
    return result


def worst_error_px(island: list[Placement], truth: dict[str, Shot]) -> float:
    """Of any frame: RMS distance of its pixels from their true places after one similarity of the island, on the plane that
    suits the island best."""
    found = np.array([canvas_from_pixels(p.pose, p.camera, pixel_grid(p.camera, 5, 4)) for p in island])
    planes = np.array([truth[p.name].ground for p in island]).swapaxes(0, 1)
    return min(worst_on_plane(true, found) for true in planes)


def worst_on_plane(true: Array, found: Array) -> float:
    scale, angle, shift = similarity_between(true.reshape(-1, 2), found.reshape(-1, 2))
    c, s = math.cos(angle), math.sin(angle)
    off = scale * true @ np.array([[c, s], [-s, c]]) + shift - found
    return float(np.sqrt((off**2).sum(axis=2).mean(axis=1)).max())
