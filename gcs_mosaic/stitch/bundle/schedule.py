"""When islands are adjusted as a whole: small ones at once, large ones in the background while frames are being placed.

An island is due whenever it has grown by one part in so many, so that the total cost of its adjustments is proportional to its
number of frames. Background results are a few frames old: newer frames are carried along (`island.take_in`).

Each island is either adjusted or unchanged, independently of the others. The worker is another process, unaffected by rollbacks
here; so it only computes a function of its task, and gets the task again if it has another one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from gcs_mosaic.stitch.bundle.island import IslandTask, adjust_island, island_task, take_in
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.worker import Worker, WorkerFailed
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.transaction import EachWhole, Kept, Snapshot


@dataclass(frozen=True, slots=True, kw_only=True)
class UpkeepSettings:
    """When islands are adjusted as a whole."""

    per_doubling: int = 8  # an island is adjusted whenever it has grown by one part in so many
    # frames from which an island is adjusted in the background: smaller ones take no longer than a frame
    background_from: int = 24
    # when punctual, an island's result of n frames is taken in n / meanwhile frames later, on any machine
    meanwhile: int = 64


class Upkeep(Kept):
    """Keeps the islands of a graph adjusted. `punctual`: results are taken in after a fixed number of frames, waiting if
    necessary, so that the map is deterministic; otherwise as soon as they are ready. `adjusted(island)` is called when an
    island's frames have new poses."""

    FIXED = frozenset({"_graph", "_worker", "_worker_is_at", "_adjusted"})

    def __init__(
        self,
        graph: ViewGraph,
        settings: UpkeepSettings,
        adjustment: AdjustmentSettings,
        worker: Worker | None = None,
        *,
        punctual: bool = False,
        adjusted: Callable[[int], None] = lambda island: None,
    ) -> None:
        self._graph = graph
        self._settings = settings
        self._adjustment = adjustment
        self._worker = worker
        self._worker_is_at: IslandTask | None = None  # None also while uncertain
        self._worker_failed = False
        self._punctual = punctual
        self._adjusted = adjusted
        self._grown: dict[int, int] = {}  # frames that islands have gained since their last adjustment
        self._task: IslandTask | None = None  # the worker's task
        self._frames_before = 0  # in the graph when it began
        self.problem: str | None = None  # the last failure in the background

    def saved(self) -> Snapshot:
        """An adjustment that is under way is due again."""
        saved = super().saved() | {"_task": None, "_worker_failed": False, "problem": None}
        if self._task is not None:
            grown = self._grown.get(self._task.island, 0) + len(self._task.members)
            saved["_grown"] = self._grown | {self._task.island: grown}
        return saved

    def grow(self, island: int, frames: int = 1) -> None:
        """To be called when an island has gained frames."""
        self._grown[island] = self._grown.get(island, 0) + frames

    def forget(self, island: int) -> None:
        """To be called when an island has been merged into another."""
        self._grown.pop(island, None)

    def after_frame(self) -> None:
        """After each frame, placed or not: take in what is due, adjust what has grown enough.

        May be called again after an exception, or at any other time: nothing is done twice.
        """
        self._each(self._steps(self._take_in_when_due, self._due))

    def in_a_pause(self) -> bool:
        """When idle: adjust everything that has grown. True while a background adjustment is running."""
        self._each(self._steps(self._take_in_when_due, lambda: list(self._grown)))
        return self._task is not None

    def finish(self) -> None:
        """Adjust everything that has grown, synchronously."""
        self._each(self._steps(self._take_in, lambda: list(self._grown), at_once=True))

    def _steps(
        self, first: Callable[[], None], islands: Callable[[], list[int]], *, at_once: bool = False
    ) -> Iterator[Callable[[], None]]:
        yield first
        for island in islands():  # taking in a result may have changed the list
            yield partial(self._adjust, island, at_once=at_once)

    def _each(self, steps: Iterable[Callable[[], None]]) -> None:
        """Run each step atomically. If one raises, the others still run; the first error is raised at the end."""
        with EachWhole(self._graph, self, otherwise="an island was not adjusted") as each:
            for step in steps:
                each.tried(step)

    def _due(self) -> list[int]:
        sizes = {island: self._graph.count_members(island) for island in self._grown}
        return [island for island, size in sizes.items() if self._grown[island] * self._settings.per_doubling >= size]

    def _adjust(self, island: int, *, at_once: bool) -> None:
        large = self._graph.count_members(island) >= self._settings.background_from
        if at_once or not large or self._helper is None:
            del self._grown[island]
            adjust_island(self._graph, island, self._adjustment)
            self._adjusted(island)
        elif self._task is None:
            self._begin(island)

    def _begin(self, island: int) -> None:
        del self._grown[island]
        self._task = island_task(self._graph, island, self._adjustment)
        self._frames_before = len(self._graph.frames)
        if self._task is not None:
            self._asked(self._task)

    @property
    def _helper(self) -> Worker | None:
        return None if self._worker_failed else self._worker

    def _asked(self, task: IslandTask) -> Worker:
        """The worker, running this task."""
        assert self._worker is not None, "only a worker is given tasks"
        if self._worker_is_at is not task:
            self._worker_is_at = None
            self._worker.begin(task)
            self._worker_is_at = task
        return self._worker

    def _take_in_when_due(self) -> None:
        if self._task is None:
            return
        frames = max(1, len(self._task.members) // self._settings.meanwhile)
        since = len(self._graph.frames) - self._frames_before
        if since >= frames if self._punctual else self._asked(self._task).is_ready():
            self._take_in()

    def _take_in(self) -> None:
        """Wait for the result and use it, unless the island has been merged into another."""
        task, self._task = self._task, None
        if task is None:
            return
        found = self._asked(task).result()
        if isinstance(found, WorkerFailed):
            # A flight whose map pauses now and then is better than none.
            self.problem = f"{found.reason}; from now on frames wait while it is adjusted"
            self._worker_failed = True
            self.grow(task.island, len(task.members))
        elif take_in(self._graph, task, found):
            self._adjusted(task.island)
