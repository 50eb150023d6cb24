"""When islands are adjusted as a whole: small ones at once, large ones in the background while frames go on being placed.

An island is due whenever it has grown by one part in so many, so that all its adjustments together cost in proportion to
its frames. What comes back from the background is a few frames old: those are carried along (`solving.take_in`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_mosaic.stitch.adjusting.adjustment import AdjustmentSettings
from gcs_mosaic.stitch.adjusting.background import Failed, Worker
from gcs_mosaic.stitch.adjusting.solving import IslandTask, adjust_island, island_task, take_in
from gcs_mosaic.stitch.network import Network


@dataclass(frozen=True, slots=True, kw_only=True)
class UpkeepSettings:
    """When islands are adjusted as a whole."""

    per_doubling: int = 16  # an island is adjusted whenever it has grown by one part in so many
    # frames of an island that is adjusted in the background: smaller ones take no longer than a frame
    background_from: int = 100
    # a folder's island of n frames takes in its adjustment n / meanwhile frames later, on any machine
    meanwhile: int = 64


class Upkeep:
    """Keeps the islands of a network adjusted. `punctual`: results are taken in after a fixed number of frames, waited for
    if need be, so that the same frames always give the same map; otherwise as soon as they are there. `adjusted(island)` is
    called when the frames of an island have been laid anew."""

    def __init__(
        self,
        network: Network,
        settings: UpkeepSettings,
        adjustment: AdjustmentSettings,
        worker: Worker | None = None,
        *,
        punctual: bool = False,
        adjusted: Callable[[int], None] = lambda island: None,
    ) -> None:
        self._network = network
        self._settings = settings
        self._adjustment = adjustment
        self._worker = worker
        self._punctual = punctual
        self._adjusted = adjusted
        self._grown: dict[int, int] = {}  # frames that islands have gained since they were adjusted
        self._task: IslandTask | None = None  # what the worker is at
        self._frames_since = 0  # since it was given that
        self.problem: str | None = None  # what has last gone wrong in the background

    def grow(self, island: int, frames: int = 1) -> None:
        """An island has gained frames."""
        self._grown[island] = self._grown.get(island, 0) + frames

    def forget(self, island: int) -> int:
        """An island is no more; returns the frames that it had gained."""
        return self._grown.pop(island, 0)

    def after_frame(self) -> None:
        """A frame has been placed, or not: take in what is due, adjust what has grown enough."""
        self._frames_since += 1
        self._take_in_when_due()
        for island, grown in list(self._grown.items()):
            if grown * self._settings.per_doubling >= self._network.count_members(island):
                self._adjust(island)

    def in_a_pause(self) -> bool:
        """No frame has come for a while: adjust whatever has grown. True while there is something under way."""
        self._take_in_when_due()
        for island in list(self._grown):
            self._adjust(island)
        return self._task is not None

    def finish(self) -> None:
        """Adjust everything that has grown, here and now."""
        self._take_in()
        for island in list(self._grown):
            self._adjust_at_once(island)

    def _adjust(self, island: int) -> None:
        large = self._network.count_members(island) >= self._settings.background_from
        if self._worker is None or not large:
            self._adjust_at_once(island)
        elif self._task is None:
            self._begin(self._worker, island)

    def _adjust_at_once(self, island: int) -> None:
        del self._grown[island]
        adjust_island(self._network, island, self._adjustment)
        self._adjusted(island)

    def _begin(self, worker: Worker, island: int) -> None:
        task = island_task(self._network, island, self._adjustment)
        if task is not None:
            worker.begin(task)
            self._task, self._frames_since = task, 0
        del self._grown[island]

    def _take_in_when_due(self) -> None:
        if self._task is None or self._worker is None:
            return
        frames = max(1, len(self._task.members) // self._settings.meanwhile)
        if self._frames_since >= frames if self._punctual else self._worker.is_ready():
            self._take_in()

    def _take_in(self) -> None:
        """Wait for the result and use it, unless the island has become part of another one."""
        task, self._task = self._task, None
        if task is None or self._worker is None:
            return
        found = self._worker.result()
        if isinstance(found, Failed):
            # A flight whose map stands still now and then is better than none.
            self.problem = f"{found.reason}; from now on frames wait while it is adjusted"
            self._worker = None
            self.grow(task.island, len(task.members))
        elif take_in(self._network, task, found):
            self._adjusted(task.island)
