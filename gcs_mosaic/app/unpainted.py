"""Frames that are placed but not painted yet."""

from __future__ import annotations

from collections.abc import Iterable

from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept

MOST_TRIES = 3  # a failure this persistent will recur, and every try costs a frame's time


class Unpainted(Kept):
    """Placements of these frames, and how often painting each has failed."""

    def __init__(self) -> None:
        self._placements: dict[str, Placement] = {}
        self._failures: dict[str, int] = {}

    def add(self, placements: Iterable[Placement]) -> None:
        """Add frames to be painted, or update their placements; frames given up are ignored."""
        self._placements |= {one.name: one for one in placements if self._failures.get(one.name, 0) < MOST_TRIES}

    def all(self) -> list[Placement]:
        """The frames to be painted, in the order added."""
        return list(self._placements.values())

    def remove(self, name: str) -> None:
        """The frame has been painted."""
        del self._placements[name]

    def forget(self, name: str) -> None:
        """The frame is not to be painted any more, if it waits for that."""
        self._placements.pop(name, None)

    def give_up(self, name: str) -> None:
        """Never try this frame again."""
        self._failures[name] = MOST_TRIES
        del self._placements[name]

    def fail(self, name: str) -> bool:
        """Count a failure to paint; returns whether to retry."""
        self._failures[name] = self._failures.get(name, 0) + 1
        if self._failures[name] < MOST_TRIES:
            return True
        self.give_up(name)
        return False
