"""What was seen, against what each cell's middle says when it is looked up in every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.render.tile_grid import Tile, tile_box
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pixels_from_canvas
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.coverage import Grid, footprint_of, gaps_in, seen_on
from gcs_mosaic.views.flight_view import FrameTable, table_of

CAMERA = Camera(400, 300, focal=1.3, k1=-0.08)


def table(poses: Sequence[Pose]) -> FrameTable:
    frames = [
        PositionRecord(
            number=k + 1, name=f"{k}.jpg", island=0, order=k, level=16, pose=pose, camera=CAMERA, modified=1000.0 + k
        )
        for k, pose in enumerate(poses)
    ]
    return table_of(1, frames)


def lanes(columns: range, rows: range, *, without: Sequence[tuple[int, int]] = ()) -> list[Pose]:
    places = [(column, row) for row in rows for column in columns if (column, row) not in without]
    return [Pose(column * 200.0, row * 150.0, yaw=0.1 * (column % 3), log_gsd=0.02 * row) for column, row in places]


def looks_by_hand(grid: Grid, poses: Sequence[Pose]) -> np.ndarray:
    x = grid.left + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.top + (np.arange(grid.rows) + 0.5) * grid.cell
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    seen = np.zeros(len(places), int)
    for pose in poses:
        pixels = pixels_from_canvas(pose, CAMERA, places)
        seen += ((pixels > -0.5) & (pixels < [CAMERA.width - 0.5, CAMERA.height - 0.5])).all(axis=1)
    return seen.reshape(grid.rows, grid.columns)


def test_looks_are_those_of_the_frames_true_outlines() -> None:
    poses = [*lanes(range(6), range(5)), Pose(500.0, 300.0, pitch=0.9)]  # the last is oblique
    grid = Grid(-300, -300, 10.0, 160, 130)
    found = seen_on(grid, table(poses), range(len(poses)))
    true = looks_by_hand(grid, poses)
    assert (found.looks == true).mean() > 0.98
    assert np.abs(found.looks - true).max() <= 3  # where borders of several frames meet in one cell


def test_the_finest_and_the_newest_are_told_for_each_cell() -> None:
    poses = [Pose(0, 0, log_gsd=0.0), Pose(0, 0, log_gsd=-0.7)]
    found = seen_on(Grid(-400, -400, 10.0, 80, 80), table(poses), [0, 1], np.array([1000.0, 1001.0]))
    assert found.finest[40, 40] == pytest.approx(np.exp(-0.7))
    assert found.finest[40, 25] == pytest.approx(1.0)
    assert (found.newest[40, 40], found.newest[40, 25]) == (1001.0, 1000.0)
    assert found.looks[0, 0] == 0
    assert np.isinf(found.finest[0, 0])
    assert np.isnan(found.newest[0, 0])


def test_gaps_are_holes_and_narrow_bays_and_nothing_else() -> None:
    whole, hole = lanes(range(10), range(8)), [(4, 3), (5, 3), (4, 4), (5, 4)]
    grid = Grid(-400, -400, 12.0, 220, 170)
    poses = lanes(range(10), range(8), without=hole)
    frames = table(poses)
    footprint = footprint_of(frames.boxes)
    assert gaps_in(seen_on(grid, table(whole), range(len(whole))), footprint) == []
    (gap,) = gaps_in(seen_on(grid, frames, range(len(poses))), footprint)
    bare = (looks_by_hand(grid, poses) == 0) & (looks_by_hand(grid, whole) > 0)
    assert gap.area == pytest.approx(bare.sum() * grid.cell**2, rel=0.05)
    assert abs(gap.inside[0] - 900) < 60
    assert abs(gap.inside[1] - 525) < 60


def test_a_wide_bay_was_never_meant_to_be_flown() -> None:
    poses = [*lanes(range(3), range(10)), *lanes(range(3, 12), range(8, 10))]
    frames = table(poses)
    found = gaps_in(seen_on(Grid(-400, -400, 12.0, 260, 190), frames, range(len(poses))), footprint_of(frames.boxes))
    assert sum(gap.area for gap in found) < 0.15 * footprint_of(frames.boxes) ** 2


def test_a_tile_s_cells_lie_on_the_tile() -> None:
    box = tile_box(Tile(14, 8192, 8192))
    grid = Grid(box[0], box[1], (box[2] - box[0]) / 64, 64, 64)
    assert grid.box == pytest.approx(box)


def test_the_steepest_and_the_surest_look_are_told_for_each_cell() -> None:
    poses = [Pose(0, 0, pitch=0.5), Pose(0, 0, pitch=0.1, roll=0.2)]
    flat = table(poses)
    sure = [replace(one, corner_deviation_px=px) for one, px in zip(flat.frames, (3.0, None), strict=True)]
    found = seen_on(Grid(-100, -50, 10.0, 20, 10), table_of(1, sure), [0, 1])
    assert found.steepest[5, 10] == pytest.approx(np.degrees(np.arccos(np.cos(0.1) * np.cos(0.2))))
    assert found.surest[5, 10] == pytest.approx(3.0)
    assert np.isinf(seen_on(Grid(-100, -50, 10.0, 20, 10), table_of(1, sure), [1]).surest).all()
