"""A frame on the tiles of its level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.render.cells import Window, window_of
from gcs_mosaic.render.light_field import factors
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.sampling import at_cells, lattice_part
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.render.vignetting import FLAT, brightening
from gcs_mosaic.render.warp import refined
from gcs_mosaic.render.warp_grid import FrameLattice, frame_lattice
from gcs_mosaic.stitch.arrays import Lattice


@dataclass(frozen=True, slots=True, eq=False)
class FrameWarp:
    """`brightening`: factor at the lattice points, by band, that removes the vignetting and applies the light
    field; None for a factor of 1."""

    painted: RenderItem
    lattice: FrameLattice
    brightening: Lattice | None

    @property
    def nbytes(self) -> int:
        """Size of its arrays."""
        parts = (self.lattice.pixels, self.lattice.weight, self.lattice.useful, self.lattice.covered, self.brightening)
        return sum(part.nbytes for part in parts if part is not None)

    @property
    def window(self) -> Window:
        return window_of(self.painted.island, self.lattice)

    def factors(self, window: Window, at: Callable[[Lattice], Lattice] = at_cells) -> list[Lattice | np.float32]:
        """Factors of blue, green and red at the cells of a window, or at other places between lattice points."""
        gains = [np.float32(gain) for gain in self.painted.display.of_shown(self.painted.gain)]
        if self.brightening is None:
            return list(gains)
        bright = at(self.brightening[lattice_part(self.lattice, window)])
        return [bright[..., band] * gain for band, gain in zip(self.painted.display.shown, gains, strict=True)]


def frame_warp(painted: RenderItem, before: FrameWarp | None = None) -> FrameWarp | None:
    """The frame on its tiles; None where it sees no ground. `before`: the same frame as painted before, whose lattice may be
    reused. ValueError if the level is absurdly fine for it."""
    known = before is not None and _lies_as(painted, before.painted)
    lattice = before.lattice if before is not None and known else _lattice(painted)
    if lattice is None:
        return None
    return FrameWarp(painted, lattice, brightening_of(painted, lattice.pixels))


def on_level(frame: FrameWarp, window: Window) -> FrameWarp | None:
    """The frame on a window of tiles of its own level or a finer one, exactly where its own tiles have it; None if disjoint.
    Values between its lattice points are their means, independent of the window."""
    finer = window.level - frame.lattice.first.z
    above = window.above(finer).common(frame.window)
    if above is None or finer == 0:
        return None if above is None else frame
    where = lattice_part(frame.lattice, above)

    def fine(values: Lattice) -> Lattice:
        part = values[where]
        for _ in range(finer):
            part = refined(part)
        return part

    lattice = replace(
        frame.lattice,
        first=Tile(window.level, above.left << finer, above.top << finer),
        last=Tile(window.level, ((above.right + 1) << finer) - 1, ((above.bottom + 1) << finer) - 1),
        pixels=fine(frame.lattice.pixels),
        weight=fine(frame.lattice.weight) * np.float32(0.25**finer),  # proportional to the square of the resolution
        useful=None if frame.lattice.useful is None else fine(frame.lattice.useful),
        covered=None if frame.lattice.covered is None else fine(frame.lattice.covered),
    )
    return FrameWarp(frame.painted, lattice, None if frame.brightening is None else fine(frame.brightening))


def brightening_of(painted: RenderItem, pixels: Lattice) -> Lattice | None:
    """Factor (h, w, bands or 1) at pixels (h, w, 2) of a frame besides its gain; None for a factor of 1."""
    size, field = (painted.camera.width, painted.camera.height), painted.light
    even = None if painted.vignetting == FLAT else brightening(painted.vignetting, pixels, *size)
    if field is None:
        return even
    light = factors(field, pixels, *size)
    return light if even is None else light * even


def _lies_as(one: RenderItem, other: RenderItem) -> bool:
    alike = replace(other, gain=one.gain, vignetting=one.vignetting, light=one.light, display=one.display)
    return alike == one


def _lattice(painted: RenderItem) -> FrameLattice | None:
    hidden = painted.dead, painted.still, painted.area
    return frame_lattice(painted.pose, painted.camera, painted.level, painted.relief, *hidden)
