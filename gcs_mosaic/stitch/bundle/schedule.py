"""When islands are adjusted as a whole: small ones at once, large ones in the background while frames are being placed.

An island is due whenever it has grown by one part in so many, so that the total cost of its adjustments is proportional to its
number of frames. Background results are a few frames old: newer frames are carried along (`island.take_in`).

Each island is either adjusted or unchanged, independently of the others. The worker is another process, unaffected by rollbacks
here; so it only computes a function of its task, and gets the task again if it has another one.

An adjustment that fails in the background, such as one for which the memory is not enough, is tried again there after a pause,
and after some failures left out until its island has grown. It is never made here: what ended the worker would end the flight.
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

# In a row, of an island's adjustment in the background; the pause after each is twice as long as the one before.
TRIES = 3


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
        self._punctual = punctual
        self._adjusted = adjusted
        self._grown: dict[int, int] = {}  # frames that islands have gained since their last adjustment
        self._task: IslandTask | None = None  # the worker's task
        self._frames_before = 0  # in the graph when it began
        # How often the last adjustment of an island has failed in the background since it had grown.
        self._failures: dict[int, int] = {}
        self._pause = 0  # frames, or looks in a pause of the flight, before the worker gets another task
        self.problem: str | None = None  # the last failure in the background, until an adjustment succeeds there

    def saved(self) -> Snapshot:
        """An adjustment that is under way is due again."""
        saved = super().saved() | {"_task": None, "_failures": {}, "_pause": 0, "problem": None}
        if self._task is not None:
            grown = self._grown.get(self._task.island, 0) + len(self._task.members)
            saved["_grown"] = self._grown | {self._task.island: grown}
        return saved

    @property
    def grown(self) -> dict[int, int]:
        """Frames that islands have gained since their last adjustment, by island."""
        return dict(self._grown)

    def grow(self, island: int, frames: int = 1) -> None:
        """To be called when an island has gained frames."""
        self._grown[island] = self._grown.get(island, 0) + frames

    def forget(self, island: int) -> None:
        """To be called when an island has been merged into another."""
        self._grown.pop(island, None)
        self._failures.pop(island, None)

    def after_frame(self) -> None:
        """After each frame, placed or not: take in what is due, adjust what has grown enough.

        May be called again after an exception, or at any other time: nothing is done twice.
        """
        self._pause = max(0, self._pause - 1)
        if self._task is None:
            self._worker_is_at = None  # its task holds a copy of all matches
        self._each(self._steps(self._take_in_when_due, self._due))

    def in_a_pause(self) -> bool:
        """When idle: adjust everything that has grown. True while a background adjustment is running, or to be tried again."""
        self._pause = max(0, self._pause - 1)
        self._each(self._steps(self._take_in_when_due, lambda: list(self._grown)))
        return self._task is not None or (self._pause > 0 and bool(self._grown))

    def finish(self) -> None:
        """Adjust everything that has grown, synchronously; what failed in the background is tried there a last time."""
        self._each(self._steps(self._take_in, lambda: list(self._grown.keys() | self._failures), at_once=True))

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
        if at_once and island in self._failures:
            self._begin(island)
            self._take_in(last=True)
        elif at_once or not large or self._worker is None:
            del self._grown[island]
            adjust_island(self._graph, island, self._adjustment)
            self._adjusted(island)
        elif self._task is None and not self._pause:
            self._begin(island)

    def _begin(self, island: int) -> None:
        self._grown.pop(island, None)
        self._task = island_task(self._graph, island, self._adjustment)
        self._frames_before = len(self._graph.frames)
        if self._task is not None:
            self._asked(self._task)

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

    def _take_in(self, *, last: bool = False) -> None:
        """Wait for the result and use it, unless the island has been merged into another. `last`: there is no further try."""
        task, self._task = self._task, None
        if task is None:
            return
        found = self._asked(task).result()
        if isinstance(found, WorkerFailed):
            self._try_again(task, found, last=last)
            return
        self.problem = None
        self._failures.pop(task.island, None)
        if take_in(self._graph, task, found):
            self._adjusted(task.island)

    def _try_again(self, task: IslandTask, failed: WorkerFailed, *, last: bool) -> None:
        failures = self._failures.get(task.island, 0) + 1
        if last:
            self.problem = f"{failed.reason}: an island of {len(task.members)} frames stays as it was adjusted before"
        elif failures < TRIES:
            self.problem = f"{failed.reason}; it is tried again"
            self._failures[task.island], self._pause = failures, 2**failures
            self.grow(task.island, len(task.members))
        else:
            self.problem = (
                f"{failed.reason}, {TRIES} times in a row: this adjustment is left out until the map has grown"
            )
            self._failures[task.island] = 0
