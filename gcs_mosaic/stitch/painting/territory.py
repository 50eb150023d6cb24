"""Who shows where on all tiles, kept up to date as frames come and move."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from concurrent.futures import Executor, Future

import cv2
import numpy as np

from gcs_mosaic.stitch.painting.cells import (
    Cells,
    Owned,
    Seen,
    Window,
    alike,
    around,
    grouped,
    lay_over,
    part,
    put_together,
    touched,
    unknown,
    unowned,
    window_around,
)
from gcs_mosaic.stitch.painting.gallery import Gallery
from gcs_mosaic.stitch.painting.layers import Store
from gcs_mosaic.stitch.painting.modes import Mode
from gcs_mosaic.stitch.painting.painted import Painted, PaintedFrames, TileKey
from gcs_mosaic.stitch.painting.placed import PlacedFrame
from gcs_mosaic.stitch.painting.plans import Plan, planned
from gcs_mosaic.stitch.painting.sights import Sight
from gcs_mosaic.stitch.painting.tones import REACH, Shifts, shifts
from gcs_mosaic.stitch.transaction import Kept


class Territory(Kept):
    """The cells of tiles, and who owns them, in a store that is kept by whoever gave it, like the frames."""

    FIXED = frozenset({"_store", "_mode", "_gallery", "_frames", "_pool", "_coming"})

    def __init__(self, store: Store, mode: Mode, gallery: Gallery, frames: PaintedFrames, pool: Executor) -> None:
        self._store = store
        self._mode = mode
        self._gallery = gallery
        self._frames = frames
        self._pool = pool
        self._coming: tuple[Painted, Window, Future[Seen]] | None = None  # what comes next
        self._numbers: dict[str, int] = {}  # of all frames there ever were, by name
        self._names: list[str] = []  # by number

    def lay_over(self, frame: PlacedFrame, keys: Collection[TileKey], *, anew: bool = False) -> set[TileKey]:
        """Lay a frame over the cells of these tiles, or over those that are to take their place (`anew`); returns the tiles that
        have changed."""
        if not keys:
            return set()
        window, kind = window_around(keys), "fresh cells" if anew else "cells"
        known = self._cells(keys, window, kind)
        seen = self._seen(frame, window)
        after, other = lay_over(known, seen, self._number(frame.painted.name), self._mode.decide(known, seen))
        changed = touched(other, window).intersection(keys)
        for key in changed:
            self._store.put((key, kind), part(after, window.place(key)))
        return changed

    def expect(self, frame: PlacedFrame, keys: Collection[TileKey]) -> None:
        """Begin to see what a frame brings to the cells of these tiles, while another one is laid over them."""
        if self._gallery.has_seen(frame.painted):
            window, sight = window_around(keys), self._gallery.sight(frame.painted)
            self._coming = frame.painted, window, self._pool.submit(self._mode.see, frame, sight, window)

    def drop_fresh(self, keys: Iterable[TileKey]) -> None:
        """Forget what was laid over anew."""
        for key in keys:
            self._store.put((key, "fresh cells"), None)

    def replace(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """What was laid over anew takes its place; returns the tiles that have changed."""
        changed = set()
        for key in keys:
            before, after = self._store.get((key, "cells")), self._store.get((key, "fresh cells"))
            if before is None or after is None or not alike(before, after):
                self._store.put((key, "cells"), after)
                changed.add(key)
        self.drop_fresh(keys)
        return changed

    def settle(self, changed: Iterable[TileKey]) -> set[TileKey]:
        """Bring up to date who owns the cells of tiles that have changed, and around; returns those that may look different."""
        return set[TileKey]().union(*[self._settle(keys) for keys in grouped(changed)])

    def plans(self, keys: Iterable[TileKey]) -> dict[TileKey, Plan]:
        """What these tiles are to be made of."""
        plans: dict[TileKey, Plan] = {}
        for some in grouped(keys):
            window = window_around(some).wider()
            owned = self._owned(window.tiles(), window)
            shifted = self._shifts(owned, window) if self._mode.toned else {}
            plans |= planned(some, owned, window, shifted, self._frames_on, self._mode.sharp)
        return plans

    def _settle(self, changed: set[TileKey]) -> set[TileKey]:
        """Tiles of one level."""
        keys = around(changed)
        window = window_around(keys).wider()
        there = {key for key in window.tiles() if (key, "cells") in self._store}
        after, before = self._mode.own(self._cells(there, window, "cells")), self._owned(keys, window)
        other = np.zeros(window.shape, np.bool_)
        for key in keys:
            place = window.place(key)
            for one, another in zip(after.arrays, before.arrays, strict=True):
                other[place] |= one[place] != another[place]
        for key in touched(other, window):
            self._store.put((key, "owned"), part(after, window.place(key)) if key in there else None)
        reach = 2 * (REACH + 1) + 1 if self._mode.toned else 3
        near = cv2.dilate(other.astype(np.uint8), np.ones((reach, reach), np.uint8))
        return touched(near > 0, window) & there

    def _seen(self, frame: PlacedFrame, window: Window) -> Seen:
        coming, self._coming = self._coming, None
        if coming is not None and coming[:2] == (frame.painted, window):
            return coming[2].result()
        return self._mode.see(frame, self._gallery.sight(frame.painted), window)

    def _cells(self, keys: Iterable[TileKey], window: Window, kind: str) -> Cells:
        known = {key: one for key in keys if (one := self._store.get((key, kind))) is not None}
        put_together(cells := unknown(window.shape, self._mode.planes), known, window)
        return cells

    def _owned(self, keys: Iterable[TileKey], window: Window) -> Owned:
        known = {key: one for key in keys if (one := self._store.get((key, "owned"))) is not None}
        put_together(owned := unowned(window.shape), known, window)
        return owned

    def _shifts(self, owned: Owned, window: Window) -> dict[int, tuple[Window, Shifts]]:
        def seer(number: int) -> tuple[PlacedFrame, Sight] | None:
            painted = self._frames.get(self._names[number])
            if painted is None or (painted.island, painted.level) != (window.island, window.level):
                return None
            frame, sight = self._gallery.placed(painted), self._gallery.sight(painted)
            return None if frame is None or sight is None else (frame, sight)

        return shifts(owned.first, window, seer)

    def _frames_on(self, key: TileKey) -> dict[int, Painted]:
        return {self._number(painted.name): painted for painted in self._frames.on(key)}

    def _number(self, name: str) -> int:
        if name not in self._numbers:
            self._numbers[name] = len(self._names)
            self._names.append(name)
        return self._numbers[name]
