"""Frames that lie on the map and are not painted on it yet."""

from __future__ import annotations

from collections.abc import Iterable

from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept

MOST_TRIES = 3  # what has failed so often will go on failing, and every try costs a frame's time


class Unpainted(Kept):
    """Where these frames lie, and how often painting each of them has failed."""

    def __init__(self) -> None:
        self._placements: dict[str, Placement] = {}
        self._failures: dict[str, int] = {}

    def add(self, placements: Iterable[Placement]) -> None:
        """These are to be painted, or lie elsewhere than was known; what has been given up is not taken in again."""
        self._placements |= {one.name: one for one in placements if self._failures.get(one.name, 0) < MOST_TRIES}

    def all(self) -> list[Placement]:
        """Those to be painted, in the order in which they were added."""
        return list(self._placements.values())

    def remove(self, name: str) -> None:
        """It is painted."""
        del self._placements[name]

    def give_up(self, name: str) -> None:
        """It never will be."""
        self._failures[name] = MOST_TRIES
        del self._placements[name]

    def fail(self, name: str) -> bool:
        """It could not be painted; returns whether it is to be tried again."""
        self._failures[name] = self._failures.get(name, 0) + 1
        if self._failures[name] < MOST_TRIES:
            return True
        self.give_up(name)
        return False
