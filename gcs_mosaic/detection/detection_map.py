"""The probability of detection over an island: for each cell of a coarse grid, all looks together."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.detection.looks import look_at
from gcs_mosaic.detection.measured_frames import MeasuredFrame, MeasuredFrames
from gcs_mosaic.detection.model import (
    DIRECTION_DEG,
    Coefficients,
    coefficients,
    kept_contrast,
    of_look,
    open_to_view,
    through_leaves,
    together,
)
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Array, Indices, Mask, PointsNx2
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance, pixels_from_canvas
from gcs_mosaic.views.coverage import Coverage, Gap, Grid, cells_of, footprint_of, nearest_cells
from gcs_mosaic.views.flight_view import FlightView, FrameTable, pixels_of

PER_FOOTPRINT = 12  # cells
MOST_CELLS = 512  # of a side
SQUARES = 8  # of directions each way; farther ones begin anew
SOME_GREY = "Pictures of one band state nothing: how a person stands out in them is not known."


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionMap:
    """Of an island at a revision of the map. `probability` (rows, columns): NaN where no frame states anything, 0 in gaps;
    `flown`: cells that were seen or are gaps, `is_seen`: of those that a frame which states something saw, `leaves_known`: of
    those that two looks tell whether leaves hide (others are taken for as open as they are, or for open); `measured` of
    `frames`; `is_grey`: all measured ones have one band; `troubles`: of frames that state nothing, each once."""

    revision: int
    grid: Grid
    probability: Array
    flown: Mask
    is_seen: Mask
    leaves_known: Mask
    frames: int
    measured: int
    is_grey: bool
    troubles: Sequence[str]

    def within(self, cells: Mask) -> float | None:
        """Of somebody who is anywhere in some cells with equal chance; None while nothing is known of them."""
        known = cells & np.isfinite(self.probability)
        return float(self.probability[known].mean()) if known.any() else None

    @property
    def covered(self) -> float:
        """Share of the flown area of which something is stated."""
        return float(np.isfinite(self.probability[self.flown]).mean()) if self.flown.any() else 0.0

    @property
    def leaves_unknown(self) -> float:
        """Share of the ground of which something is stated, but not whether leaves hide it."""
        return self.leaves_unknown_in(self.flown)

    def leaves_unknown_in(self, cells: Mask) -> float:
        """As `leaves_unknown`, of some cells; 0 where nothing is stated."""
        stated = cells & self.is_seen & np.isfinite(self.probability)
        return float((~self.leaves_known[stated]).mean()) if stated.any() else 0.0

    def below(self, least: float) -> Mask:
        """Cells of the flown area where it is less, or nothing is stated."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.flown & ~(self.probability >= least))

    def cells_in(self, outline: PointsNx2) -> Mask:
        """The cells of the flown area whose middles lie in an outline (n, 2) on the canvas."""
        inside = np.zeros(self.flown.shape, np.bool_)
        found = cells_of(self.grid, outline)
        if found is not None:
            inside[found[0]] = found[1]
        return inside & self.flown


class _Looks:
    """What is summed up over looks, for each cell."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.best, self.missed = np.zeros(shape), np.zeros(shape)
        self.open, self.opens = np.zeros(shape), np.zeros(shape)
        self.directions = np.zeros(shape, np.uint64)
        self.is_seen = np.zeros(shape, np.bool_)

    def add(self, rows: Indices, columns: Indices, single: Array, is_open: Array, squares: Array) -> None:
        at = rows, columns
        self.best[at] = np.maximum(self.best[at], single)
        self.missed[at] += np.log1p(-np.minimum(single, 1 - 1e-9))
        known = np.isfinite(is_open)
        self.open[at] += np.where(known, is_open, 0)
        self.opens[at] += known
        self.directions[at] |= np.left_shift(np.uint64(1), squares.astype(np.uint64))
        self.is_seen[at] = True

    def probability(self, fitted: Coefficients) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            is_open = self.open / self.opens
        usual = float(np.nanmedian(is_open)) if np.isfinite(is_open).any() else 1.0  # as `leaves_known` tells
        is_open = np.where(np.isfinite(is_open), is_open, usual)
        directions = np.unpackbits(self.directions.view(np.uint8).reshape(*self.directions.shape, 8), axis=-1).sum(-1)
        found = together(self.best, self.missed, fitted) * through_leaves(is_open, directions, fitted)
        return np.where(self.is_seen, found, np.nan)


def detection_map(
    view: FlightView,
    island: int,
    whole: Coverage,
    gaps: Sequence[Gap],
    measured: MeasuredFrames,
    person: Person,
    side: float,
    numbers: Collection[int] | None = None,
) -> DetectionMap:
    """Of an island, of what is measured so far. `whole`, `gaps`: what was seen of it, and what not; `side`: of the person;
    `numbers`: of the frames that count, None for all."""
    table = view.table()
    grid = _coarse(whole.grid, footprint_of(table.boxes[table.islands == island]))
    looks = _Looks((grid.rows, grid.columns))
    ours, unstated = _members(table, island, numbers), np.zeros_like(looks.is_seen)
    of_frames = [measured.of(table.frames[index]) for index in ours]
    for index, found in zip(ours, of_frames, strict=True):
        painted = view.painted(table.frames[index].number)
        if found is not None and found.ground is not None and not found.ground.is_grey and painted is not None:
            _add(looks, grid, table, index, found, painted, person, side)
        elif (cells := cells_of(grid, table.outlines[index])) is not None:
            unstated[cells[0]] |= cells[1]
    seen = _resampled(whole.looks > 0, whole.grid, grid)
    bare = _gap_cells(grid, gaps) & ~seen
    known = [found for found in of_frames if found is not None]
    grey = [one.ground.is_grey for one in known if one.ground is not None]
    troubles = {found.trouble for found in known} | {measured.put_off(table.frames[index]) for index in ours}
    return DetectionMap(
        revision=table.revision,
        grid=grid,
        probability=np.where(bare, 0.0, looks.probability(coefficients())),
        flown=(seen & (looks.is_seen | unstated)) | bare,  # not the rim of cells whose middles no frame saw
        is_seen=looks.is_seen,
        leaves_known=looks.opens > 0,
        frames=len(ours),
        measured=len(known),
        is_grey=bool(grey) and all(grey),
        troubles=sorted((troubles - {""}) | ({SOME_GREY} if any(grey) else set())),
    )


def _members(table: FrameTable, island: int, numbers: Collection[int] | None) -> list[int]:
    """Rows of an island's frames; of those with these numbers, if any are given."""
    members = (index for index, one in enumerate(table.frames) if one.island == island)
    return [index for index in members if numbers is None or table.frames[index].number in numbers]


def _add(
    looks: _Looks,
    grid: Grid,
    table: FrameTable,
    index: int,
    found: MeasuredFrame,
    painted: RenderItem,
    person: Person,
    side: float,
) -> None:
    cells = cells_of(grid, table.outlines[index])
    if cells is None or found.ground is None:
        return
    down, across = np.nonzero(cells[1])
    rows, columns = down + cells[0][0].start, across + cells[0][1].start
    places = np.stack([grid.left + (columns + 0.5) * grid.cell, grid.top + (rows + 0.5) * grid.cell], axis=-1)
    seen = pixels_of(painted, places)
    gsd = ground_sampling_distance(
        painted.pose, painted.camera, pixels_from_canvas(painted.pose, painted.camera, places)
    )
    width, height = painted.camera.width, painted.camera.height
    inside = np.isfinite(gsd) & ((seen > -0.5) & (seen < [width - 0.5, height - 0.5])).all(axis=1)
    if not inside.any():
        return
    rows, columns, places, seen, gsd = rows[inside], columns[inside], places[inside], seen[inside], gsd[inside]
    per_painted = found.ground.width / width
    fitted, sharp = coefficients(), float(table.sharpness[index])
    look = look_at(found.ground, found.differs, (seen + 0.5) * per_painted - 0.5, person)
    kept = kept_contrast(side / gsd * per_painted, np.full(len(gsd), sharp if np.isfinite(sharp) else 1.0))
    single = (of_look(look.in_sun, kept, fitted) + of_look(look.in_shade, kept, fitted)) / 2
    is_open = open_to_view(look.disagreement, look.texture, fitted)
    looks.add(rows, columns, single, is_open, _squares(painted, places))


def _squares(painted: RenderItem, places: PointsNx2) -> Array:
    """Numbers of the squares of directions from which places (n, 2) are seen."""
    height = np.exp(painted.pose.log_gsd) * painted.camera.focal_px
    angles = np.degrees(np.arctan2(places - [painted.pose.x, painted.pose.y], height))
    across, down = (np.floor(angles / DIRECTION_DEG).astype(int) % SQUARES).T
    return np.asarray(SQUARES * across + down)


def _coarse(grid: Grid, footprint: float) -> Grid:
    left, top, right, bottom = grid.box
    cell = max(footprint / PER_FOOTPRINT, (right - left) / MOST_CELLS, (bottom - top) / MOST_CELLS, grid.cell)
    return Grid(left, top, cell, int(np.ceil((right - left) / cell)), int(np.ceil((bottom - top) / cell)))


def _gap_cells(grid: Grid, gaps: Sequence[Gap]) -> Mask:
    found = np.zeros((grid.rows, grid.columns), np.bool_)
    for gap in gaps:
        cells = cells_of(grid, np.array(gap.outline))
        if cells is not None:
            found[cells[0]] |= cells[1]
    return found


def _resampled(cells: Mask, of: Grid, grid: Grid) -> Mask:
    known, at = nearest_cells(of, grid)
    return np.asarray(known & cells[at])
