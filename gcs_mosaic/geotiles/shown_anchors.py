"""The anchors by which other programs' maps show the flight; not each newly fitted one, or the map would creep there.

During a flight an anchor by positions is fitted anew with every frame, and each fit lies a little elsewhere. Other maps keep
tiles, and people compare what they see with what they saw. So an anchor stays until another one is worth it:

* a corner of the island would move by more than a third of the new one's stated error there: less is little against what the
  map may be off by anyway;
* or the stated error of the worst corner fell by a quarter or grew by a third: what was said of the map is no longer true;
* or people have changed what lays it (set or deleted pins, asked for positions): then at once.

An island without a fit is no longer shown, and one that has been joined to another has none.
"""

from __future__ import annotations

import threading
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.render.tile_grid import Box

MOVED_SHARE = 1 / 3  # of the new stated error
ERROR_FELL = 3 / 4
ERROR_GREW = 4 / 3


@dataclass(frozen=True, slots=True)
class FittedIsland:
    """How an island is laid now. `box`: of its canvas; `given`: what people have said of it, to be compared."""

    anchor: Anchor
    box: Box
    given: Hashable


@dataclass(frozen=True, slots=True)
class ShownAnchors:
    """What is shown of each island; `revision` counts the changes."""

    revision: int = 0
    islands: Mapping[int, FittedIsland] = field(default_factory=dict)

    def after(self, fitted: Mapping[int, FittedIsland]) -> Self:
        """What is shown after these fits; itself if nothing is worth a change."""
        shown = {
            island: fit if self._is_worth_it(island, fit) else self.islands[island] for island, fit in fitted.items()
        }
        if shown == self.islands:
            return self
        return type(self)(self.revision + 1, shown)

    @property
    def anchors(self) -> dict[int, Anchor]:
        return {island: fit.anchor for island, fit in self.islands.items()}

    def _is_worth_it(self, island: int, fit: FittedIsland) -> bool:
        shown = self.islands.get(island)
        return shown is None or shown.given != fit.given or is_worth_it(shown.anchor, fit.anchor, fit.box)


def is_worth_it(shown: Anchor, new: Anchor, box: Box) -> bool:
    """Whether a new anchor replaces the one that is shown, of an island with this box."""
    left, top, right, bottom = box
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    there, here = new.plane.spots(shown.places(corners)), new.plane.spots(new.places(corners))
    moved = np.hypot(*(there - here).T)
    stated = np.array([new.error(*corner).major_m for corner in corners.tolist()])
    before = max(shown.error(*corner).major_m for corner in corners.tolist())
    return bool((moved > MOVED_SHARE * stated).any()) or not ERROR_FELL < stated.max() / before < ERROR_GREW


class AnchorFollower:
    """Keeps what is shown, for several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._shown = ShownAnchors()

    def follow(self, fitted: Mapping[int, FittedIsland]) -> ShownAnchors:
        """What is shown after these fits."""
        with self._lock:
            self._shown = self._shown.after(fitted)
            return self._shown
