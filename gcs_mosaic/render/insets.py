"""Insets: frames of coarser levels on finer tiles, so that what was seen only from higher up stays on the map.

Finer tiles hide coarser ones, and people seen only there. So a frame of a coarser level is an inset on the finer tiles below it:
it shows where it has a salient thing (`saliency`) that the host frame lacks. The two see the ground at different scales: what
is salient from high up may be a roof, which at close range is salient only near its edge. So the host is also analysed at the
inset's resolution, and what is salient there counts as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.render.blend_maps import AT_ONCE, BlendMaps, contrasts_around
from gcs_mosaic.render.cells import NOBODY, WHOLLY, Cells, Window, laid, part
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.saliency import WAYS
from gcs_mosaic.render.sampling import at_middles
from gcs_mosaic.render.seams import FAR, LOOK, SALIENT, THINGS, beyond, contrasts_at, decide, only, see
from gcs_mosaic.render.warp_grid import LATTICE
from gcs_mosaic.stitch.arrays import Mask, Planes

# A frame and its look on a window of tiles, by number; None if it is not there.
Seer = Callable[[Window, int], tuple[FrameWarp, BlendMaps] | None]
Admit = Callable[[Cells, Window, "Things", int, Seer], Cells]

GROUPS = -(-WAYS // AT_ONCE)  # of planes that hold the things
POINTS = LATTICE - 1  # of the lattice along a tile's side
CLEARLY = 0.5  # share of the minimum contrast by which a thing must exceed everything near it in the host


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """Salient things of a frame, at the centres between its lattice points: `planes` (`WAYS`, h, w) over its window's tiles.

    No part of a thing is farther than `saliency.REACH` from such a centre, so at least one records the thing.
    """

    painted: RenderItem
    window: Window
    planes: Planes

    @property
    def nbytes(self) -> int:
        return self.planes.nbytes


def things(frame: FrameWarp, maps: BlendMaps) -> Things:
    """Salient things of a frame on the tiles of its own level."""
    planes = contrasts_at(frame, maps.planes[:GROUPS], frame.window, at_middles)[THINGS]
    return Things(frame.painted, frame.window, planes)


def admit(cells: Cells, window: Window, inset: Things, number: int, seer: Seer) -> Cells:
    """Cells (h, w) of a window with an inset as the first where only it has a thing. It covers no empty cells: those are left to
    tiles of its own level. The window is aligned to tiles `INSET_LEVELS` coarser."""
    changed = [
        (one, after)
        for one, there in _where_it_may(cells, window, inset)
        if (after := _with_inset(part(cells, window.of(one)), one, there, number, seer))
    ]
    if not changed:
        return cells
    cells = Cells(*[array.copy() for array in cells.arrays])
    for one, after in changed:
        rows, columns = window.of(one)
        for array, values in zip(cells.arrays, after.arrays, strict=True):
            array[..., rows, columns] = values
    return cells


def _where_it_may(cells: Cells, window: Window, inset: Things) -> Iterator[tuple[Window, Mask]]:
    """Parts of a window as large as the inset's own tiles, with a mask of their cells (h, w): where a quick check, one per square
    between lattice points, finds things of the inset that the host lacks."""
    finer = window.level - inset.window.level
    above = window.above(finer).common(inset.window)
    if above is None:
        return
    (rows, columns), middle, side = window.of(above.below(finer)), 1 << finer, 2 << finer
    each = np.s_[rows.start + middle : rows.stop : side, columns.start + middle : columns.stop : side]
    y, x = (above.top - inset.window.top) * POINTS, (above.left - inset.window.left) * POINTS
    around = cells.planes[(FAR, *each)]
    stands_out = beyond(inset.planes[:, y : y + around.shape[1], x : x + around.shape[2]], around) >= CLEARLY
    maybe = (cells.first[each] != NOBODY) & stands_out
    for y, x in np.argwhere(maybe.reshape(len(maybe) // POINTS, POINTS, -1, POINTS).any(axis=(1, 3))).tolist():
        there = maybe[y * POINTS : (y + 1) * POINTS, x * POINTS : (x + 1) * POINTS]
        yield above.part(y, x).below(finer), there.repeat(side, axis=0).repeat(side, axis=1)


def _with_inset(cells: Cells, window: Window, there: Mask, number: int, seer: Seer) -> Cells | None:
    """The cells of a window with the inset shown on some of the cells `there`; None if on none."""
    known = seer(window, number)
    assert known is not None, "it has been seen there"
    inset, maps = known
    seen = see(inset, maps, window)
    decided = SALIENT * (
        only(seen.planes, cells.planes, FAR) - only(cells.planes, seen.planes, FAR) - np.float32(CLEARLY)
    )
    wins = there & (cells.first != NOBODY) & (seen.inside == WHOLLY) & (decided > 0)
    for host in np.unique(cells.first[wins]).tolist():
        here = wins & (cells.first == host)
        beside = seer(window, host)
        if beside is None:
            wins &= ~here
        elif beside[0].painted.level != window.level:  # another inset: the better view wins
            wins &= ~here | (decide(cells, seen) > 0)
        else:
            around = _seen_coarsely(*beside, window, 2.0 ** (window.level - inset.painted.level))
            wins &= ~here | (beyond(seen.planes[THINGS], around) >= CLEARLY)
    return laid(cells, seen, number, decided, wins, np.zeros_like(wins)) if wins.any() else None


def _seen_coarsely(frame: FrameWarp, maps: BlendMaps, window: Window, coarser: float) -> Planes:
    """Salience far around the cells of a window in a frame at `coarser` times lower resolution, by kind of contrast."""
    here = frame.window.common(window)
    assert here is not None, "it is seen there"
    whole = np.zeros((WAYS, *window.shape), np.uint8)
    rows, columns = window.of(here)
    whole[:, rows, columns] = contrasts_at(frame, contrasts_around(maps, LOOK, coarser), here)
    return whole
