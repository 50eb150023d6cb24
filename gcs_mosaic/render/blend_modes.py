"""Blend modes by name: which frame shows where is decided on cells; the pixels follow from that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.render import edges, seams
from gcs_mosaic.render.blend_maps import BlendMaps, Of
from gcs_mosaic.render.cells import OPEN, Cells, Owned, Seen, Window
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.insets import Admit, admit
from gcs_mosaic.render.sampling import hindrance, inside, lattice_part
from gcs_mosaic.render.seam_path import hard
from gcs_mosaic.stitch.arrays import ImageBGR, Lattice


@dataclass(frozen=True, slots=True)
class Mode:
    """A blend mode.

    `look`: what is kept of a frame's (reduced) image; None: nothing. `see`: a frame's contribution to a window of its tiles.
    `decide`: (present cells, new frame) -> above 0 where the new frame is to show, with the margin as magnitude. `own`: final
    owners of the cells, which depend on no cell farther away than one tile. `planes`: number kept per cell. `admit`: lets a
    frame of a coarser level show where it has what no other frame has; None: never. `toned`: whether tones are equalised along
    seams. `sharp`: whether each cell belongs to one frame.
    """

    see: Callable[[FrameWarp, BlendMaps | None, Window], Seen]
    decide: Callable[[Cells, Seen], Lattice]
    own: Callable[[Cells], Owned]
    look: Callable[[ImageBGR, Of], BlendMaps] | None = None
    planes: int = 0
    admit: Admit | None = None
    toned: bool = False
    sharp: bool = True


def _just_there(frame: FrameWarp, maps: BlendMaps | None, window: Window) -> Seen:
    where = lattice_part(frame.lattice, window)
    covered = inside(frame.lattice, where)
    return Seen(covered, -hindrance(frame.lattice, where, covered), np.zeros((0, *covered.shape), np.uint8))


def _newest(cells: Cells, seen: Seen) -> Lattice:
    return np.asarray(seen.score - cells.score + OPEN, np.float32)


def _first(cells: Cells, seen: Seen) -> Lattice:
    return np.asarray(seen.score - cells.score - OPEN, np.float32)


def _as_decided(cells: Cells) -> Owned:
    return hard(cells, np.zeros(cells.first.shape, np.bool_))


MODES: dict[str, Mode] = {
    "seam": Mode(seams.see, seams.decide, seams.steered, seams.look_for_seams, seams.KEPT, admit, toned=True),
    "edge": Mode(edges.see, edges.decide, edges.mixed, edges.look_for_edges, 1, sharp=False),
    "newest": Mode(_just_there, _newest, _as_decided),
    "first": Mode(_just_there, _first, _as_decided),
}
