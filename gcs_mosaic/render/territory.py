"""Cell ownership on all tiles, kept up to date as frames arrive and move."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.blend_modes import Mode
from gcs_mosaic.render.cells import (
    NOBODY,
    Cells,
    Owned,
    Seen,
    Window,
    alike,
    around,
    grouped,
    in_blocks,
    lay_in_place,
    lay_over,
    part,
    put_together,
    shares,
    touched,
    unknown,
    unowned,
    view,
    window_around,
)
from gcs_mosaic.render.frame_cache import FrameCache
from gcs_mosaic.render.frame_warp import FrameWarp, on_level
from gcs_mosaic.render.insets import Things, things
from gcs_mosaic.render.plans import Plan, planned
from gcs_mosaic.render.render_list import INSET_LEVELS, RenderItem, RenderList, TileKey
from gcs_mosaic.render.spread import ahead
from gcs_mosaic.render.tile_cache import Store
from gcs_mosaic.render.tone import REACH, shifts
from gcs_mosaic.stitch.arrays import ToneShifts
from gcs_mosaic.stitch.transaction import Kept

EXPECTED = 3  # contributions computed ahead: of the frame that is laid over, and of the next two meanwhile
UNKNOWN = -1  # in place of a number of frames
SETTLED = 16  # tiles a side whose owners are decided together

Settled = tuple[dict[TileKey, Owned | None], set[TileKey]]  # owners that are new, and the tiles that may look different


@dataclass(slots=True, eq=False)
class _Fresh:
    """Cells of a window that are being decided again, in place, so no snapshot restores them: `laid`, the number of frames laid
    over them, tells whether they are those of the present state."""

    window: Window
    cells: Cells
    laid: int = 0


class Territory(Kept):
    """The cells of tiles and their owners, in a store that its owner restores, like the frames."""

    FIXED = frozenset({"_store", "_mode", "_frame_cache", "_frames", "_pool", "_coming", "_fresh"})

    def __init__(self, store: Store, mode: Mode, frame_cache: FrameCache, frames: RenderList, pool: Executor) -> None:
        self._store = store
        self._mode = mode
        self._frame_cache = frame_cache
        self._frames = frames
        self._pool = pool
        # Contributions of the frame that is laid over next and of those after it, by name.
        self._coming: dict[str, tuple[RenderItem, Window, Future[Seen]]] = {}
        self._fresh: _Fresh | None = None
        self._numbers: dict[str, int] = {}  # of all frames ever seen, by name
        self._names: list[str] = []  # by number
        # By host: its frames and insets when these were let in to its present cells.
        self._let_in: dict[TileKey, tuple[RenderItem, ...]] = {}

    def lay_over(self, frame: FrameWarp, keys: Collection[TileKey]) -> set[TileKey]:
        """Lay a frame over the cells of these tiles; returns the tiles that have changed."""
        if not keys:
            return set()
        window = window_around(keys)
        known = self._cells(keys, window, "cells")
        seen = self._seen(frame, window)
        after, other = lay_over(known, seen, self._number(frame.painted.name), self._mode.decide(known, seen))
        changed = touched(other, window).intersection(keys)
        for key in changed:
            self._store.put((key, "cells"), part(after, window.place(key)))
        self._forget_insets(changed)
        return changed

    def begin_anew(self, keys: Collection[TileKey]) -> None:
        """Begin to decide the cells of these tiles again, all of one level and close together."""
        window = window_around(keys)
        self._fresh = _Fresh(window, unknown(window.shape, self._mode.planes))

    def has_laid(self, count: int) -> bool:
        """Whether so many frames, and no other, have been laid over the cells that are being decided again."""
        return self._fresh is not None and self._fresh.laid == count

    def lay_anew(self, frame: FrameWarp, keys: Collection[TileKey]) -> None:
        """Lay a frame over those of these tiles' cells that are being decided again."""
        assert self._fresh is not None, "they have been begun"
        fresh, window = self._fresh, window_around(keys)
        cells, count = view(fresh.cells, fresh.window.of(window)), fresh.laid
        seen = self._seen(frame, window)
        decided = self._mode.decide(cells, seen)
        fresh.laid = UNKNOWN  # until all is laid
        lay_in_place(cells, seen, self._number(frame.painted.name), decided, *shares(cells, seen, decided))
        fresh.laid = count + 1

    def expect(self, frame: FrameWarp, keys: Collection[TileKey]) -> None:
        """Begin to compute a frame's contribution to the cells of these tiles, while others are laid over them."""
        window = window_around(keys)
        known = self._coming.get(frame.painted.name)
        is_new = known is None or known[:2] != (frame.painted, window)
        if is_new and self._frame_cache.has_seen(frame.painted):
            maps = self._frame_cache.blend_maps(frame.painted)
            while len(self._coming) >= EXPECTED:
                del self._coming[next(iter(self._coming))]
            seen = self._pool.submit(self._mode.see, frame, maps, window)
            self._coming[frame.painted.name] = frame.painted, window, seen

    def drop_fresh(self) -> None:
        """Discard cells decided again."""
        self._fresh = None

    def replace(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """Replace cells by those decided again; returns the tiles that have changed."""
        assert self._fresh is not None, "they have been begun"
        changed = set()
        for key in keys:
            before, after = self._store.get((key, "cells")), part(self._fresh.cells, self._fresh.window.place(key))
            anybody = bool((after.first != NOBODY).any())
            if (before is not None) != anybody or (before is not None and not alike(before, after)):
                self._store.put((key, "cells"), after if anybody else None)
                changed.add(key)
        self.drop_fresh()
        self._forget_insets(changed)
        return changed

    def hosts(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """Those of these tiles that may have insets."""
        return {key for key in keys if self._mode.admit is not None and self._frames.insets_on(key)}

    def with_insets(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """Those of these tiles that show insets."""
        return {key for key in keys if (key, "hosted") in self._store}

    def hosts_below(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """The finer tiles on which frames of these tiles may be insets."""
        return set() if self._mode.admit is None else self._frames.hosts_below(keys)

    def settle(self, changed: Iterable[TileKey]) -> set[TileKey]:
        """Update cell owners of changed tiles and their neighbours; returns the tiles that may look different."""
        self.let_insets_in(changed)
        return set[TileKey]().union(*[self._settle(keys) for keys in grouped(changed)])

    def let_insets_in(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """Recompute where insets show things on tiles that no frame painted there has; returns the tiles on which that has
        changed, to be settled."""
        return set[TileKey]().union(*[self._let_insets_in(some) for some in grouped(keys)])

    def plans(self, keys: Iterable[TileKey]) -> dict[TileKey, Plan]:
        """Plans of these tiles."""
        plans: dict[TileKey, Plan] = {}
        for some in grouped(keys):
            window = window_around(some).wider()
            owned = self._owned(window.tiles(), window)
            shifted = self._shifts(owned, window) if self._mode.toned else {}
            plans |= planned(some, owned, window, shifted, self._frames_on, self._mode.sharp)
        return plans

    def _settle(self, changed: set[TileKey]) -> set[TileKey]:
        """As `settle`, for tiles of one level."""
        due = set[TileKey]()
        works = (self._settling(keys) for keys in in_blocks(around(changed), SETTLED))
        for owned, looks_different in ahead(self._pool, works):
            for key, one in owned.items():
                self._store.put((key, "owned"), one)
            due |= looks_different
        return due

    def _settling(self, keys: set[TileKey]) -> Callable[[], Settled]:
        """A work that finds the owners of a few tiles, which uses the store no more."""
        window = window_around(keys).wider()
        there = {key for key in window.tiles() if (key, "cells") in self._store}
        cells, before = self._cells(there, window, "hosted", "cells"), self._owned(keys, window)
        return partial(_settled, self._mode, keys, there, window, cells, before)

    def _seen(self, frame: FrameWarp, window: Window) -> Seen:
        coming = self._coming.pop(frame.painted.name, None)
        if coming is not None and coming[:2] == (frame.painted, window):
            return coming[2].result()
        return self._mode.see(frame, self._frame_cache.blend_maps(frame.painted), window)

    def _let_insets_in(self, keys: set[TileKey]) -> set[TileKey]:
        """As `let_insets_in`, for tiles of one level. What is known of a tile is a function of its cells and of these frames."""
        hosts = {key for key in self.hosts(keys) if (key, "cells") in self._store}
        changed = {key for key in keys - hosts if self._note_hosted(key, None)}
        self._forget_insets(keys - hosts)
        frames = {key: (*self._frames.on(key), *self._frames.insets_on(key)) for key in hosts}
        hosts = {key for key in hosts if self._let_in.get(key) != frames[key]}
        if not hosts or self._mode.admit is None:
            return changed
        window = window_around(hosts).above(INSET_LEVELS).below(INSET_LEVELS)
        before = cells = self._cells(hosts, window, "cells")
        insets = {one.name: one for key in hosts for one in self._frames.insets_on(key)}
        for painted in sorted(insets.values(), key=lambda one: one.turn):
            if (known := self._things(painted)) is not None:
                cells = self._mode.admit(cells, window, known, self._number(painted.name), self._seer)
        hosting = touched(cells.first != before.first, window)
        for key in hosts:
            if self._note_hosted(key, part(cells, window.place(key)) if key in hosting else None):
                changed.add(key)
        if all(map(self._frame_cache.has_seen, {one.name: one for key in hosts for one in frames[key]}.values())):
            self._let_in |= {key: frames[key] for key in hosts}
        return changed

    def _note_hosted(self, key: TileKey, cells: Cells | None) -> bool:
        """Note a tile's cells with insets, None without any; returns whether that differs from what was known."""
        before = self._store.get((key, "hosted"))
        self._store.put((key, "hosted"), cells)
        return before is not cells and (before is None or cells is None or not alike(before, cells))

    def _forget_insets(self, keys: Iterable[TileKey]) -> None:
        for key in keys:
            self._let_in.pop(key, None)

    def _cells(self, keys: Iterable[TileKey], window: Window, *kinds: str) -> Cells:
        """Cells of tiles, each of the first of these kinds that exists."""
        found = {key: next((kind for kind in kinds if (key, kind) in self._store), None) for key in keys}
        known = {key: self._store.get((key, kind)) for key, kind in found.items() if kind is not None}
        put_together(cells := unknown(window.shape, self._mode.planes), known, window)
        return cells

    def _owned(self, keys: Iterable[TileKey], window: Window) -> Owned:
        known = {key: one for key in keys if (one := self._store.get((key, "owned"))) is not None}
        put_together(owned := unowned(window.shape), known, window)
        return owned

    def _shifts(self, owned: Owned, window: Window) -> dict[int, tuple[Window, ToneShifts]]:
        return shifts(owned.first, window, partial(self._seer, window), self._pool)

    def _things(self, painted: RenderItem) -> Things | None:
        """Salient things of a frame; None if unknown."""
        known: Things | None = self._store.get(("things", painted.name))
        if known is None or known.painted != painted:
            frame = self._frame_cache.warp(painted) if self._frame_cache.has_seen(painted) else None
            maps = self._frame_cache.blend_maps(painted)
            known = None if frame is None or maps is None else things(frame, maps)
            self._store.put(("things", painted.name), known)
        return known

    def _seer(self, window: Window, number: int) -> tuple[FrameWarp, BlendMaps] | None:
        """A frame on a window, and its look; None if it is no longer there."""
        painted = self._frames.get(self._names[number])
        if painted is None or not _may_be_on(painted, window):
            return None
        frame, maps = self._frame_cache.warp(painted), self._frame_cache.blend_maps(painted)
        here = None if frame is None else on_level(frame, window)
        return None if here is None or maps is None else (here, maps)

    def _frames_on(self, key: TileKey) -> dict[int, RenderItem]:
        """All frames that may show on a tile, in capture order."""
        there = sorted([*self._frames.on(key), *self._frames.insets_on(key)], key=lambda painted: painted.turn)
        return {self._number(painted.name): painted for painted in there}

    def _number(self, name: str) -> int:
        if name not in self._numbers:
            self._numbers[name] = len(self._names)
            self._names.append(name)
        return self._numbers[name]


def _settled(
    mode: Mode, keys: Iterable[TileKey], there: set[TileKey], window: Window, cells: Cells, before: Owned
) -> Settled:
    """Owners of the cells of a window, of whose tiles these are `there`, for those of `keys` where they differ from `before`."""
    after = mode.own(cells)
    other = np.zeros(window.shape, np.bool_)
    for key in keys:
        place = window.place(key)
        for one, another in zip(after.arrays, before.arrays, strict=True):
            other[place] |= one[place] != another[place]
    owned = {key: part(after, window.place(key)) if key in there else None for key in touched(other, window)}
    reach = 2 * (REACH + 1) + 1 if mode.toned else 3
    near = cv2.dilate(other.astype(np.uint8), np.ones((reach, reach), np.uint8))
    return owned, touched(near > 0, window) & there


def _may_be_on(painted: RenderItem, window: Window) -> bool:
    return painted.island == window.island and 0 <= window.level - painted.level <= INSET_LEVELS
