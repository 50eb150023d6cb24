"""Runs the tasks of a stage on a cluster: in batches, again where a worker has died, anew where the store has lost something.

A worker that dies costs the tasks that it had: Dask gives them to another one. What kills one worker after the other is found by
running the tasks of such a batch one by one, and those that seem to kill alone, with nothing beside them that could be the cause.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any
from uuid import uuid4

from distributed import CancelledError, Client, wait
from distributed.client import FutureCancelledError
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.progress import Progress, StageCost
from gcs_mosaic.archive.tasks import Batch, Made, StageTask, Unmade, artefacts_at, listed, run_batch
from gcs_mosaic.archive.versions import OtherVersions, versions
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.store.disk import CannotWrite

logger = logging.getLogger(__name__)

GONE = (CancelledError, FutureCancelledError, CommClosedError, TimeoutError, OSError)
AGAIN = "what was made is kept; put that right and give the command again"
AHEAD = 4  # batches submitted for each worker: enough that none waits, few enough for the scheduler's memory
LOOK_S = 10.0  # how often is looked whether there are workers,
SAY_EACH = 30  # and how often, in looks, it is said that there are none
MOST_LOSSES = 3  # times that an artefact may get lost

Outcome = Made | Unmade


class Engine:
    """Runs stages for one client. `store`: the artefacts' place, the same for all workers."""

    def __init__(self, client: Client, store: str, progress: Progress) -> None:
        self._client = client
        self._store = store
        self._progress = progress
        self._makers: dict[str, StageTask] = {}
        self._lists: dict[str, Sequence[Any]] = {}
        self._losses: dict[str, int] = {}

    @property
    def artefacts(self) -> Artefacts:
        return artefacts_at(self._store)

    def run(self, stage: str, tasks: Sequence[StageTask], batch: int = 1) -> list[Outcome]:
        """The outcome of each task, in order; `batch`: how many a worker is given together.

        Raises FlightFailed if the store goes on losing an artefact, and what Dask raises when the scheduler is gone.
        """
        self._makers |= {one.key: one for one in tasks}
        cost = StageCost(stage, len(tasks))
        self._progress.begin(cost)
        start, found = time.monotonic(), dict[str, Outcome]()
        for key, outcome in self._outcomes(_chunks(_unlike(tasks), batch)):
            found[key] = outcome
            if isinstance(outcome, Made):
                cost.add(outcome.seconds)
            self._progress.advance(cost.at(time.monotonic() - start))
        self._progress.end(cost.at(time.monotonic() - start))
        return [found[one.key] for one in tasks]

    def made(self, stage: str, tasks: Sequence[StageTask], batch: int = 1) -> list[Any]:
        """As `run` for tasks of which none may fail: their summaries. Raises FlightFailed."""
        outcomes = self.run(stage, tasks, batch)
        for outcome in outcomes:
            if isinstance(outcome, Unmade):
                raise FlightFailed(
                    f"{stage}: {outcome.reason}; what was made so far is kept, so give the command again"
                )
        return [outcome.summary for outcome in outcomes if isinstance(outcome, Made)]

    @contextmanager
    def alone(self, stage: str) -> Iterator[None]:
        """A stage of one step that the client makes itself."""
        cost, start, used = StageCost(stage, 1), time.monotonic(), time.process_time()
        self._progress.begin(cost)
        yield
        cost.add(time.process_time() - used)
        self._progress.end(cost.at(time.monotonic() - start))

    def _outcomes(
        self, batches: Iterable[tuple[StageTask, ...]], *, anew: bool = False
    ) -> Iterator[tuple[str, Outcome]]:
        """The outcomes of all batches by key, each task once; `anew`: although their artefacts seem to be there."""
        suspects: list[StageTask] = []
        for tasks, outcome in self._each(batches, anew=anew):
            if outcome is None:
                suspects += tasks
            else:
                yield from self._settled(tasks, outcome, anew=anew)
        guilty: list[StageTask] = []
        for tasks, outcome in self._each(((one,) for one in suspects), anew=anew):
            if outcome is None:
                guilty += tasks
            else:
                yield from self._settled(tasks, outcome, anew=anew)
        for one in guilty:
            yield from self._alone(one, anew=anew)

    def _alone(self, one: StageTask, *, anew: bool) -> Iterator[tuple[str, Outcome]]:
        """A task that may kill workers, with nothing beside it."""
        for tasks, outcome in self._each([(one,)], anew=anew):
            if outcome is not None:
                yield from self._settled(tasks, outcome, anew=anew)
                continue
            logger.warning("the task %s has killed its workers", one.key)
            yield one.key, Unmade("its task has killed one worker after the other")

    def _each(
        self, batches: Iterable[tuple[StageTask, ...]], *, anew: bool = False
    ) -> Iterator[tuple[tuple[StageTask, ...], list[Outcome] | None]]:
        """Batches with their outcomes as they come; None if they have killed their workers."""
        coming, of = iter(batches), dict[Any, tuple[StageTask, ...]]()

        def submitted(count: int) -> None:
            of.update(
                {self._submitted(Batch(self._store, some, versions(), anew)): some for some in islice(coming, count)}
            )

        try:
            submitted(AHEAD * max(1, self._workers()))
            while of:
                for future in self._done(list(of)):
                    tasks = of.pop(future)
                    yield tasks, self._result(future, tasks)
                    future.release()
                    submitted(1)
        except GONE as error:
            logger.debug("the scheduler is gone", exc_info=True)
            raise FlightFailed(f"the scheduler is gone ({type(error).__name__}): {AGAIN}") from None

    def _done(self, futures: list[Any]) -> list[Any]:
        """Those that are done, at least one; while there is no worker that is said."""
        lonely = 0  # looks in a row that found no worker: one that has died is back after the next
        while True:
            try:
                return list(wait(futures, timeout=LOOK_S, return_when="FIRST_COMPLETED").done)
            except TimeoutError:
                lonely = 0 if self._workers() else lonely + 1
                if lonely % SAY_EACH == 2:
                    self._progress.say("there is no worker: waiting for one")

    def _submitted(self, batch: Batch) -> Any:
        """A future; its name begins with that of the function, by which Dask shows it."""
        return self._client.submit(run_batch, batch, pure=False, key=f"{batch.tasks[0].work.__name__}-{uuid4()}")

    def _workers(self) -> int:
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def _result(self, future: Any, tasks: Sequence[StageTask]) -> list[Outcome] | None:
        try:
            return list(future.result())
        except KilledWorker:
            return None
        except (CannotWrite, UsageError) as error:  # of the store or the archive, not of what is in it
            raise FlightFailed(f"{error}; {AGAIN}") from None
        except OtherVersions as error:
            raise FlightFailed(f"{error}; install the same on all workers, and give the command again") from None
        except Exception as error:
            if future.status != "error":  # it is not the task's: the scheduler is gone
                raise
            if len(tasks) > 1:
                return None  # each by itself tells which
            logger.warning("%s has failed", tasks[0].key, exc_info=True)
            return [Unmade(f"it could not be processed ({error!r})")]

    def _settled(
        self, tasks: Sequence[StageTask], outcomes: Sequence[Outcome], *, anew: bool
    ) -> Iterator[tuple[str, Outcome]]:
        """The outcomes; what missed an artefact is made again once that is."""
        for one, outcome in zip(tasks, outcomes, strict=True):
            while isinstance(outcome, Unmade) and outcome.lost is not None:
                self._make_again(outcome.lost)
                outcome = dict(self._outcomes([(one,)], anew=anew))[one.key]
            yield one.key, outcome

    def _make_again(self, key: str) -> None:
        """Make an artefact that an earlier stage made, and what that one misses in turn."""
        self._losses[key] = self._losses.get(key, 0) + 1
        if key not in self._makers.keys() | self._lists.keys() or self._losses[key] > MOST_LOSSES:
            raise FlightFailed(
                f"the store {self._store} has lost {key}: see that it keeps what it is given, and give the command again"
            )
        logger.warning("the store has lost %s: it is made again", key)
        if key in self._lists:
            listed(self.artefacts, self._lists[key])
            return
        one = self._makers[key]
        for _, outcome in self._outcomes([(one,)], anew=True):
            if isinstance(outcome, Unmade):
                raise FlightFailed(f"{key} was lost and cannot be made again: {outcome.reason}")

    def listed(self, values: Sequence[Any]) -> str:
        """As `tasks.listed`, and put there again if it is lost."""
        key = listed(self.artefacts, values)
        self._lists[key] = values
        return key

    def part(self, key: str, name: str) -> Any:
        """A part of an artefact, made again if it is lost. For the client itself."""
        while True:
            try:
                return self.artefacts.part(key, name)
            except Lost:
                self._make_again(key)


def _unlike(tasks: Iterable[StageTask]) -> list[StageTask]:
    """Each artefact is made once, though two files may hold the same picture."""
    return list({one.key: one for one in tasks}.values())


def _chunks(items: Sequence[StageTask], size: int) -> Iterator[tuple[StageTask, ...]]:
    return (tuple(items[at : at + size]) for at in range(0, len(items), size))
