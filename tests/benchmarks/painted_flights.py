"""Flights painted by the product's own renderer: the map of each blending mode, and each frame alone on the same grid.

A simulated flight lies where its truth says, a recorded one where the stitching puts it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.app.waiting.prefetch import DecodedFrame, prepare, thumbnail
from gcs_mosaic.frames.decode import Unreadable, decode_image, load_image
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import Frame
from gcs_mosaic.render.blend_maps import LOOK_PIXELS
from gcs_mosaic.render.compositor import INTERPOLATIONS, TileCompositor
from gcs_mosaic.render.edges import edge_density
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.pixels import frame_picture, piece
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings, RepaintQueue
from gcs_mosaic.render.sampling import places_in, sampled
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, level_from_canvas
from gcs_mosaic.render.warp import shrunk, upscale
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.stitch.camera.relief import on_plane
from gcs_mosaic.stitch.features.extraction import extract
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import StitchSettings
from sitl.camera import Scene
from sitl.flight import Flight
from sitl.geometry import CameraState, Lens, world_from_camera
from sitl.truth import Truth
from tests.benchmarks.known_flights import stitched

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Weights = NDArray[np.float32]

NEIGHBOURS = 12  # frames that one is linked with, as in a stitched flight


@dataclass(frozen=True, slots=True)
class PlacedFlight:
    """A flight whose frames have their places. `load` gives a frame's picture by name, `bare` the same without targets."""

    name: str
    placements: tuple[Placement, ...]  # in capture order
    load: Callable[[str], Bands]
    bare: Callable[[str], Bands] | None = None
    truth: Truth | None = None


def simulated(flight: Flight, *, registered: bool = False) -> PlacedFlight:
    """A simulated flight where its truth says or, `registered`, where the stitching puts it. Its pictures are files as a camera
    writes them."""
    bare = Flight(scene=_without_targets(flight.scene), states=flight.states, names=flight.names)
    files, bare_files = (dict(zip(flight.names, one.pictures(), strict=True)) for one in (flight, bare))
    if registered:
        settings = StitchSettings()
        placed = stitched(
            [(name, extract(_decoded(data), settings.features)) for name, data in files.items()], settings
        )
    else:
        placed = _true_placements(flight)
    return PlacedFlight(
        name="simulated",
        placements=tuple(placed),
        load=lambda name: _decoded(files[name]),
        bare=lambda name: _decoded(bare_files[name]),
        truth=flight.truth(),
    )


def recorded(folder: Path, reduction: int = 1, most: int | None = None) -> PlacedFlight:
    """A folder of photographs, or the first few of them, stitched; painted at full size or reduced by a whole factor."""
    settings = StitchSettings()
    frames = [one for one in frames_in([folder], FolderSettings()).frames if isinstance(one, Frame)][:most]
    prepared = (prepare(one, partial(extract, settings=settings.features)) for one in frames)
    features = [(one.frame.name, one.features) for one in prepared if isinstance(one, DecodedFrame)]
    placements, paths = stitched(features, settings), {one.name: one.path for one in frames}

    def load(name: str) -> Bands:
        image = load_image(paths[name], reduction=reduction)
        assert not isinstance(image, Unreadable), image
        return image

    order = {name: k for k, name in enumerate(paths)}
    return PlacedFlight(folder.name, tuple(sorted(placements, key=lambda one: order[one.name])), load)


@dataclass(frozen=True, slots=True)
class PaintedMap:
    """A painted flight: its tiles, and how each frame is painted on them."""

    canvas: TileCompositor
    frames: dict[str, RenderItem]


@contextmanager
def painted_map(flight: PlacedFlight, settings: PaintSettings) -> Iterator[PaintedMap]:
    """The map as it is when the flight has ended."""
    frames: dict[str, RenderItem] = {}

    def record(painted: RenderItem) -> None:
        frames[painted.name] = painted

    queue = RepaintQueue(TileCompositor(flight.load, settings.canvas), record, settings)
    try:
        for order, placement in enumerate(flight.placements):
            image = flight.load(placement.name)
            queue.paint_new(image, thumbnail(image), placement, order)
        for _ in queue.repaint_all(flight.placements):
            pass
        yield PaintedMap(queue.canvas, frames)
    finally:
        queue.close()


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of pixels of one level of the main island."""

    island: int
    level: int
    x: int
    y: int
    width: int
    height: int

    def meets(self, other: Window) -> bool:
        """Whether a pixel of this level belongs to both."""
        across = self.x < other.x + other.width and other.x < self.x + self.width
        return across and self.y < other.y + other.height and other.y < self.y + self.height

    def tiles(self) -> Iterator[Tile]:
        for y in range(self.y // TILE_SIZE, (self.y + self.height - 1) // TILE_SIZE + 1):
            for x in range(self.x // TILE_SIZE, (self.x + self.width - 1) // TILE_SIZE + 1):
                yield Tile(self.level, x, y)


@dataclass(frozen=True, slots=True)
class Seen:
    """What is seen in a window: colour (h, w, 3) BGR, covered (h, w). Of a frame also how well it sees each place, weight
    (h, w), and how dense edges are there, density (h, w); both are 0 for a map."""

    colour: Image
    covered: Mask
    weight: Weights
    density: Weights


TileParts = tuple[Image, Image, Weights | float, Weights | float]  # colour, coverage, weight, density


def shown(canvas: TileCompositor, window: Window) -> Seen:
    """What the map shows."""

    def tile(at: Tile) -> TileParts | None:
        picture = canvas.tile(window.island, at)
        return None if picture is None else (picture.colour, picture.coverage, 0.0, 0.0)

    return _assembled(window, tile)


class FrameAlone:
    """One frame as it is painted, with nothing else on the tiles."""

    def __init__(self, image: Bands, painted: RenderItem, settings: PaintSettings) -> None:
        frame = frame_warp(painted)
        assert frame is not None
        self.painted = painted
        self.tiles = set(frame.lattice.tiles())
        self._frame = frame
        self._picture = frame_picture(image, painted, "none")
        self._density = edge_density(shrunk(self._picture.image, LOOK_PIXELS))
        self._interpolation = INTERPOLATIONS[settings.canvas.interpolation]
        self._made: dict[Tile, TileParts | None] = {}

    def touches(self, window: Window) -> bool:
        same = (window.island, window.level) == (self.painted.island, self.painted.level)
        return same and not self.tiles.isdisjoint(window.tiles())

    def in_window(self, window: Window) -> Seen:
        return _assembled(window, self._tile)

    def _tile(self, at: Tile) -> TileParts | None:
        if at not in self._made:
            self._made[at] = self._parts(at) if at in self.tiles else None
        return self._made[at]

    def _parts(self, at: Tile) -> TileParts | None:
        made = piece(self._frame, self._picture, at, None, self._interpolation, "none")
        if made is None:
            return None
        lattice = self._frame.lattice
        pixels = upscale(lattice.pixels[lattice.window(at)])
        density = sampled(self._density, places_in(pixels, lattice, self._density.shape))
        coverage = full_coverage(TILE_SIZE) if made.coverage is None else made.coverage
        return made.colour, coverage, upscale(made.weight).copy(), density


def place_in_level(painted: RenderItem, pixels: Array) -> Array:
    """Pixel coordinates (n, 2) on the frame's level of pixels (n, 2) of the frame; pixel k lies around k."""
    places = canvas_from_pixels(painted.pose, painted.camera, on_plane(painted.relief, painted.camera, pixels))
    return np.asarray(level_from_canvas(painted.level, places) - 0.5)


def _assembled(window: Window, tile: Callable[[Tile], TileParts | None]) -> Seen:
    size = window.height, window.width
    seen = Seen(np.zeros((*size, 3), np.uint8), np.zeros(size, np.bool_), *np.zeros((2, *size), np.float32))
    for at in window.tiles():
        found = tile(at)
        if found is None:
            continue
        top, left = at.y * TILE_SIZE - window.y, at.x * TILE_SIZE - window.x
        rows, columns = _common(top, window.height), _common(left, window.width)
        there = slice(rows.start, rows.stop), slice(columns.start, columns.stop)
        here = slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
        seen.colour[there], seen.covered[there] = found[0][here], found[1][here] == 255
        for values, part in ((seen.weight, found[2]), (seen.density, found[3])):
            values[there] = part if isinstance(part, float) else part[here]
    return seen


def _common(start: int, length: int) -> slice:
    """Where a tile that starts at `start` lies within a window of this length."""
    return slice(max(0, start), min(length, start + TILE_SIZE))


def _without_targets(scene: Scene) -> Scene:
    return Scene(world=scene.world, camera=scene.camera, relief=scene.relief, seed=scene.seed)


def _decoded(data: bytes) -> Bands:
    image = decode_image(data)
    assert not isinstance(image, Unreadable), image
    return image


def _true_placements(flight: Flight) -> list[Placement]:
    """Where the frames truly lie, on a canvas whose unit is a pixel of the first frame."""
    lens = flight.scene.camera.lens
    unit = flight.states[0].height / lens.focal_px
    places = np.array([(state.x, state.y) for state in flight.states])
    reach = max(lens.footprint(min(state.height for state in flight.states)))
    placements = []
    for k, (name, state) in enumerate(zip(flight.names, flight.states, strict=True)):
        away = np.linalg.norm(places[:k] - places[k], axis=1)
        near = [int(i) for i in np.argsort(away)[:NEIGHBOURS] if away[i] < reach]
        placements.append(_placement(name, state, lens, unit, tuple(flight.names[i] for i in near)))
    return placements


def _placement(name: str, state: CameraState, lens: Lens, unit: float, neighbours: tuple[str, ...]) -> Placement:
    turned = world_from_camera(state)
    pose = Pose(
        x=state.x / unit,
        y=state.y / unit,
        log_gsd=math.log(state.height / lens.focal_px / unit),
        yaw=math.atan2(turned[1, 0], turned[0, 0]),
        pitch=-math.asin(turned[2, 0]),
        roll=math.atan2(turned[2, 1], turned[2, 2]),
    )
    camera = Camera(lens.width, lens.height, lens.focal, lens.k1)
    return Placement(name, 0, pose, camera, None, 100, 0.0, neighbours, 0, 0.0)
