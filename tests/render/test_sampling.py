from typing import Any

import numpy as np
import pytest
from painting_parts import hilly, painted, picture

from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.cells import CELL, PARTLY, WHOLLY, Window
from gcs_mosaic.render.display import PLAIN
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.sampling import at_cells, at_middles, inside, lattice_part
from gcs_mosaic.render.warp import tile_picture
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from tests.sure import sure

FLAG = 1
FRAME: dict[str, Any] = {
    "gsd": 0.3,
    "yaw": 0.4,
    "pitch": 0.2,
    "relief": hilly(1),
    "gain": (1.1, 0.9, 1.0),
    "vignetting": ((0.2, -0.3, 0.0), (0.0, -0.2, 0.0), (0.0, -0.1, 0.0)),
}


@pytest.mark.parametrize("mode", MODES)
def test_a_part_of_a_frame_is_seen_as_the_whole_is(mode: str) -> None:
    frame = sure(frame_warp(painted(0, **FRAME)))
    look = MODES[mode].look
    maps = None if look is None else look(picture(0), (PLAIN, frame.painted.dead))
    window = frame.window
    part = window._replace(left=window.left + 1, bottom=window.bottom - 1)
    whole, cut = MODES[mode].see(frame, maps, window), MODES[mode].see(frame, maps, part)
    rows, columns = window.of(part)
    for name in ("inside", "score", "planes"):
        np.testing.assert_array_equal(getattr(whole, name)[..., rows, columns], getattr(cut, name))


@pytest.mark.parametrize("dead", [DeadBorder(), DeadBorder(3, 0, 20, 7)])
def test_a_cell_is_covered_as_its_pixels_are(dead: DeadBorder) -> None:
    frame = sure(frame_warp(painted(0, **FRAME, dead=dead)))
    found = {0: 0, PARTLY: 0, WHOLLY: 0}
    for tile in frame.lattice.tiles():
        window = Window(0, tile.z, tile.y, tile.x, tile.y, tile.x)
        cells = inside(frame.lattice, lattice_part(frame.lattice, window))
        coverage = tile_picture(frame.lattice, picture(0), tile, FLAG)[1]
        pixels = np.full((256, 256), 255) if coverage is None else coverage
        share = pixels.reshape(32, CELL, 32, CELL).mean(axis=(1, 3)) / 255
        assert (share[cells == WHOLLY] == 1).all()
        assert (share[cells == 0] == 0).all()
        for kind in found:
            found[kind] += int((cells == kind).sum())
    assert min(found.values()) > 10


def test_values_at_cells_and_between_lattice_points_are_bilinear() -> None:
    points = np.add.outer(16.0 * np.arange(4), 1600.0 * np.arange(3)).astype(np.float32)
    np.testing.assert_allclose(at_cells(points), np.add.outer(8 * np.arange(6) + 4, 100 * (8 * np.arange(4) + 4)))
    np.testing.assert_allclose(at_middles(points), np.add.outer(16 * np.arange(3) + 8, 100 * (16 * np.arange(2) + 8)))
