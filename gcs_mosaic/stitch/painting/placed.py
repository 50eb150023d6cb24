"""A frame on the tiles of its level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.painting.cells import Window, window_of
from gcs_mosaic.stitch.painting.lattice import FrameLattice, Lattice, frame_lattice
from gcs_mosaic.stitch.painting.painted import Painted
from gcs_mosaic.stitch.painting.sampling import at_cells, lattice_part
from gcs_mosaic.stitch.painting.vignetting import FLAT, brightening


@dataclass(frozen=True, slots=True, eq=False)
class PlacedFrame:
    """`brightening`: at the lattice points, by band, what takes the vignetting out; None: nothing has to."""

    painted: Painted
    lattice: FrameLattice
    brightening: Lattice | None

    @property
    def window(self) -> Window:
        return window_of(self.painted.island, self.lattice)

    def factors(self, window: Window, at: Callable[[Lattice], Lattice] = at_cells) -> list[Lattice | np.float32]:
        """What blue, green and red are multiplied by at the cells of a window, or at other places between lattice points."""
        gains = [np.float32(gain) for gain in self.painted.display.of_shown(self.painted.gain)]
        if self.brightening is None:
            return list(gains)
        bright = at(self.brightening[lattice_part(self.lattice, window)])
        return [bright[..., band] * gain for band, gain in zip(self.painted.display.shown, gains, strict=True)]


def placed(painted: Painted) -> PlacedFrame | None:
    """None where the frame sees no ground. ValueError if the level is absurdly fine for it."""
    camera = painted.camera
    lattice = frame_lattice(painted.pose, camera, painted.level, painted.relief, painted.dead)
    if lattice is None:
        return None
    flat = painted.vignetting == FLAT
    factor = None if flat else brightening(painted.vignetting, lattice.pixels, camera.width, camera.height)
    return PlacedFrame(painted, lattice, factor)
