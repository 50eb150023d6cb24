"""Layers over the map, painted as small tiles: each a pure function of the painted frames around.

Colours are OpenCV's tables of viridis, cividis and plasma (made for eyes that do not tell red from green); their legend is
told with them. Tiles that are coarser than an island's grid are taken from that grid, finer ones from the frames around: the cost
does not grow with the flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np

from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, pixel_size, tile_box
from gcs_mosaic.stitch.arrays import Array, FloatImage, ImageBGR, Indices, Mask
from gcs_mosaic.views.changes import Compared, FlightChanges
from gcs_mosaic.views.coverage import Coverage, Grid, IslandCoverage, nearest_cells, seen_on
from gcs_mosaic.views.flight_view import FlightView

CELLS = 64  # of a tile's side: cells of four pixels
MOST_FRAMES = 400  # for one tile; with more the island's grid will do
STOPS = 5  # colours in a legend
UNKNOWN = 90  # grey of ground of which a layer knows nothing


@dataclass(frozen=True, slots=True)
class Usual:
    """What is typical of an island: the finest usual resolution (canvas units per pixel), and the last look at any of it
    (seconds by the clock of `Coverage.newest`; NaN)."""

    finest: float
    newest: float


@dataclass(frozen=True, slots=True)
class MapLayer:
    """`share` maps what was seen, and what is typical of the island, to 0 (worst) ... 1 (best)."""

    name: str
    title: str
    worst: str
    best: str
    colours: int  # an OpenCV table
    share: Callable[[Coverage, Usual], Array]


def _of_looks(seen: Coverage, _usual: Usual) -> Array:
    return (np.minimum(seen.looks, 6.0) - 1) / 5


def _of_resolution(seen: Coverage, usual: Usual) -> Array:
    """Half as fine as the finest usual frame is the worst colour. An octave, as what can be told of a person goes by octaves."""
    with np.errstate(divide="ignore"):
        return np.asarray(1 - np.log2(seen.finest / usual.finest), np.float64)


def _of_age(seen: Coverage, usual: Usual) -> Array:
    """By octaves of minutes before the last look of all: a minute is fresh, two hours are old. Not before now: a camera's clock
    tells no zone, and a flight is looked at for years."""
    minutes = np.maximum((usual.newest - seen.newest) / 60, 1.0)
    return np.asarray(1 - np.log2(minutes) / 7)


def _of_angle(seen: Coverage, _usual: Usual) -> Array:
    """From 45 degrees on things hide what is behind them as far as they are tall."""
    return np.asarray(1 - seen.steepest / 45, np.float64)


def _of_sharpness(seen: Coverage, _usual: Usual) -> Array:
    """By an octave: half as sharp as the pictures around is the worst colour; motion of a few pixels does that."""
    return np.asarray(1 + np.log2(seen.sharpest), np.float64)


def _of_confidence(seen: Coverage, usual: Usual) -> Array:
    """By octaves of pixels: a pixel is exact, 32 are not. It knows the noise of matches only. What is not known is the worst."""
    with np.errstate(divide="ignore"):
        octaves = np.log2(np.maximum(seen.surest / usual.finest, 1.0)) / 5
    return np.asarray(1 - np.minimum(octaves, 1.0), np.float64)


LAYERS = {
    layer.name: layer
    for layer in (
        MapLayer("looks", "Number of looks", "1", "6 or more", cv2.COLORMAP_VIRIDIS, _of_looks),
        MapLayer(
            "resolution", "How finely it was seen", "half as fine", "finest", cv2.COLORMAP_CIVIDIS, _of_resolution
        ),
        MapLayer(
            "sharpness",
            "How sharp the pictures were",
            "half as sharp as others",
            "sharp",
            cv2.COLORMAP_CIVIDIS,
            _of_sharpness,
        ),
        MapLayer("angle", "How steeply it was seen", "45°", "straight down", cv2.COLORMAP_CIVIDIS, _of_angle),
        MapLayer(
            "confidence",
            "How exactly it lies, by the matches",
            "32 px or more",
            "1 px",
            cv2.COLORMAP_VIRIDIS,
            _of_confidence,
        ),
        MapLayer(
            "age", "Last look", "two hours before the last of all", "the last of all", cv2.COLORMAP_CIVIDIS, _of_age
        ),
    )
}


CHANGES = "changes"  # the layer of merged flights, which is made of their pictures
_CHANGES = MapLayer(
    CHANGES,
    "What changed between the flights",
    "a little brighter or darker",
    "twice as bright or dark",
    cv2.COLORMAP_PLASMA,
    lambda seen, _: np.zeros_like(seen.finest),
)
LEAST_CHANGE, MOST_CHANGE = 0.15, math.log(2)  # of brightness, logarithms: the ends of the colours


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerLegend:
    """What a layer shows."""

    name: str
    title: str
    worst: Annotated[str, "in words"]
    best: str
    colours: Annotated[Sequence[str], "from the worst to the best, as #rrggbb"]


def legend(layer: MapLayer) -> LayerLegend:
    """Title, words for both ends, and colours from the worst to the best, for whoever shows the tiles."""
    return LayerLegend(
        name=layer.name, title=layer.title, worst=layer.worst, best=layer.best, colours=stops_of(layer.colours)
    )


def stops_of(table: int) -> list[str]:
    """Colours of an OpenCV table from the worst to the best, as #rrggbb."""
    colours = coloured(table, np.linspace(0, 1, STOPS)[None])[0]
    return [f"#{red:02x}{green:02x}{blue:02x}" for blue, green, red in colours.tolist()]


def legends(*, merged: bool) -> list[LayerLegend]:
    """Of all layers; `merged`: whether there are several flights on the map."""
    return [legend(layer) for layer in (*LAYERS.values(), *([_CHANGES] if merged else []))]


class LayerTiles:
    """Tiles of all layers of a flight."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self.islands = IslandCoverage(view)
        self.changes = FlightChanges(view)

    def changed(self, island: int, tile: Tile) -> bytes | None:
        """A tile of what changed between merged flights, grey where that is not known: a PNG with alpha; None for nothing."""
        known = self.changes.known(island)
        if known is None or known.window is None or known.strength is None:
            return None
        greatest = _greatest(known.strength, known.window, grid_of(tile))
        share = np.asarray((greatest - LEAST_CHANGE) / (MOST_CHANGE - LEAST_CHANGE), np.float64)
        return tile_picture(_CHANGES.colours, np.where(share > 0, share, np.nan), _unknown(known, grid_of(tile)))

    def tile(self, layer: MapLayer, island: int, tile: Tile, at_least: int = 0) -> tuple[int, bytes | None]:
        """A PNG with alpha, of a revision or later if the folder is there already; None where nothing was seen. And the map's
        revision that it is of."""
        table = self._view.table(at_least)
        near = table.near(island, tile_box(tile))
        if not near:
            return table.revision, None
        found = self.islands.of(island, at_least)
        revision, whole = min(table.revision, found.revision), found.coverage
        if whole is None:
            return revision, None
        grid = grid_of(tile)
        is_coarse = len(near) > MOST_FRAMES or grid.cell > whole.grid.cell
        seen = _resampled(whole, grid) if is_coarse else seen_on(grid, table, near, self._view.taken(table))
        return revision, _encoded(layer, seen, _usual_of(whole))


def _usual_of(whole: Coverage) -> Usual:
    is_seen = whole.looks > 0
    finest = float(np.quantile(whole.finest[is_seen], 0.1)) if is_seen.any() else 1.0
    times = whole.newest[np.isfinite(whole.newest)]
    return Usual(finest, float(times.max()) if len(times) else np.nan)


def grid_of(tile: Tile) -> Grid:
    """The cells of a tile."""
    left, top, *_ = tile_box(tile)
    return Grid(left, top, pixel_size(tile.z) * TILE_SIZE / CELLS, CELLS, CELLS)


def _resampled(whole: Coverage, grid: Grid) -> Coverage:
    """The nearest cell of the island's grid for each of another grid."""
    known, at = nearest_cells(whole.grid, grid)
    looks = np.where(known, whole.looks[at], 0).astype(np.uint16)
    return Coverage(
        grid,
        looks,
        finest=whole.finest[at],
        newest=whole.newest[at],
        steepest=whole.steepest[at],
        surest=whole.surest[at],
        sharpest=whole.sharpest[at],
    )


def _greatest(strength: FloatImage, window: Grid, grid: Grid) -> FloatImage:
    """The greatest change, whatever its sign, in or beside each cell of a grid: what is small is seen from afar, too."""
    half = max(1, round(grid.cell / window.cell)) // 2  # cells of the window
    left, top = (grid.left - window.left) / window.cell, (grid.top - window.top) / window.cell
    columns = np.floor(left + (np.arange(grid.columns) + 0.5) * grid.cell / window.cell).astype(int)
    rows = np.floor(top + (np.arange(grid.rows) + 0.5) * grid.cell / window.cell).astype(int)
    is_row, is_column = (rows >= 0) & (rows < window.rows), (columns >= 0) & (columns < window.columns)
    found = np.zeros((grid.rows, grid.columns), np.float32)
    if is_row.any() and is_column.any():
        along = _greatest_around(strength, rows[is_row], half)
        found[np.ix_(is_row, is_column)] = _greatest_around(along.T, columns[is_column], half).T
    return found


def _unknown(known: Compared, grid: Grid) -> Mask | None:
    """Cells of a grid whose middles were seen and are not compared."""
    if known.window is None or known.unknown is None:
        return None
    is_near, at = nearest_cells(known.window, grid)
    return np.asarray(is_near & known.unknown[at])


def _greatest_around(values: FloatImage, rows: Indices, half: int) -> FloatImage:
    """The greatest absolute values (n, columns) within so many rows of some rows (n,)."""
    around = (np.abs(values[max(0, row - half) : row + half + 1]).max(axis=0) for row in rows.tolist())
    return np.stack(list(around)).astype(np.float32)


def _encoded(layer: MapLayer, seen: Coverage, usual: Usual) -> bytes | None:
    shown = seen.looks > 0
    return tile_picture(layer.colours, np.where(shown, layer.share(seen, usual), np.nan))


def tile_picture(table: int, share: Array, unknown: Mask | None = None) -> bytes | None:
    """A tile as a PNG of cells (CELLS, CELLS), 0 (worst) to 1 (best) in the colours of an OpenCV table; NaN is grey where it is
    unknown, else transparent. None if all are."""
    is_told = np.isfinite(share)
    shown = is_told if unknown is None else is_told | unknown
    if not shown.any():
        return None
    colours = coloured(table, np.where(is_told, share, 0.0))
    colours[~is_told] = UNKNOWN
    bgra = np.dstack([colours, np.where(shown, 255, 0).astype(np.uint8)])
    large = cv2.resize(bgra, (TILE_SIZE, TILE_SIZE), interpolation=cv2.INTER_NEAREST)
    done, data = cv2.imencode(".png", large, [cv2.IMWRITE_PNG_COMPRESSION, 4])
    return data.tobytes() if done else None


def coloured(table: int, share: Array) -> ImageBGR:
    """Shares (h, w) in the colours of an OpenCV table."""
    levels = np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, table), np.uint8)


def is_possible(tile: Tile, finest: int) -> bool:
    """Whether a tile lies on the grid of tiles."""
    return 0 <= tile.z <= finest and min(tile.x, tile.y) >= 0 and max(tile.x, tile.y) < 1 << tile.z


def area_words(area: float, footprint: float) -> str:
    """An area on the canvas in words: as long as no scale is known, by a frame's footprint."""
    share = area / footprint**2 if footprint else math.nan
    return f"about {share:.1f} frames" if share >= 0.1 else "less than a tenth of a frame"
