"""A process of its own gives the same answer, and its death is an answer too."""

import errno
import logging
import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import Image, seen

from gcs_mosaic.processes.child import ChildProcess
from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjusted, island_task
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.schedule import UpkeepSettings
from gcs_mosaic.stitch.bundle.worker import WorkerFailed, WorkerProcess
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from tests.tiers import thorough


@pytest.fixture(scope="module")
def task(ground: Image) -> IslandTask:
    mosaic = Mosaic()
    for i in range(6):
        mosaic.place(seen(ground, Pose(400 + 130 * i, 500, 0.01 * i, 0.05, 0.03), mosaic.settings.features), str(i))
    task = island_task(mosaic._graph, 0, AdjustmentSettings())
    assert task is not None
    return task


def failed(worker: WorkerProcess) -> WorkerFailed:
    found = worker.result()
    assert isinstance(found, WorkerFailed)
    return found


def process_of(worker: WorkerProcess) -> ChildProcess:
    assert worker._child is not None
    return worker._child


def signalled(worker: WorkerProcess, sign: signal.Signals) -> None:
    os.kill(process_of(worker).pid, sign)


def unreadable() -> None:
    raise ValueError("this is no task")


class Unreadable:
    """Breaks whoever unpacks it."""

    def __reduce__(self) -> tuple[Callable[[], None], tuple[()]]:
        return unreadable, ()


@pytest.fixture
def worker() -> Iterator[WorkerProcess]:
    worker = WorkerProcess()
    yield worker
    worker.close()


@pytest.mark.long
def test_it_finds_what_would_be_found_here(task: IslandTask, worker: WorkerProcess) -> None:
    worker.begin(task)
    there, here = worker.result(), adjusted(task)
    assert isinstance(there, AdjustedIsland)
    assert np.abs(here.poses - task.problem.poses).max() > 1e-3
    for name in ("poses", "lenses", "residuals", "deviations_px"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-6)


def test_a_task_that_breaks_is_told_and_the_next_one_is_done(task: IslandTask, worker: WorkerProcess) -> None:
    worker.begin(replace(task, root=99))
    assert "IndexError" in failed(worker).reason
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)


def test_the_traceback_of_the_other_process_is_in_the_log(
    task: IslandTask, worker: WorkerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    worker.begin(replace(task, root=99))
    broken = failed(worker)
    assert broken.traceback.startswith("Traceback (most recent call last):\n")
    assert re.search(r'bundle/island\.py", line \d+, in adjusted\n', broken.traceback)
    (record,) = caplog.records
    assert (record.levelname, record.getMessage()) == ("ERROR", broken.reason)
    assert broken.traceback in logging.Formatter().format(record)


def test_a_task_that_cannot_be_read_is_told_and_the_next_one_is_done(
    task: IslandTask, worker: WorkerProcess, capfd: pytest.CaptureFixture[str]
) -> None:
    worker.begin(Unreadable())  # type: ignore[arg-type]
    broken = failed(worker)
    assert "this is no task" in broken.reason
    assert "in unreadable" in broken.traceback
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)
    assert capfd.readouterr().err == ""


def test_a_process_that_is_killed_is_told_and_begun_anew(
    task: IslandTask, worker: WorkerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    worker.begin(task)
    signalled(worker, signal.SIGKILL)
    assert worker.result() == WorkerFailed("the process that adjusts the map has died")
    assert caplog.messages == ["the process that adjusts the map has died, SIGKILL"]
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)


@pytest.mark.long
def test_a_killed_process_costs_a_map_one_adjustment_and_not_those_after_it(ground: Image) -> None:
    settings = StitchSettings(upkeep=UpkeepSettings(background_from=3, per_doubling=8))
    with closing(WorkerProcess()) as worker:
        mosaic, problems = Mosaic(settings, worker, punctual=True), list[str | None]()
        for i in range(9):
            mosaic.place(seen(ground, Pose(400 + 90 * i, 500, 0.01 * i, 0.05, 0.03), mosaic.settings.features), str(i))
            mosaic.adjust()
            problems.append(mosaic.problem)
            if i == 3:
                signalled(worker, signal.SIGKILL)
    assert problems[4] == "the process that adjusts the map has died; it is tried again"
    assert problems[-1] is None
    assert problems.index(None, 4) > 4


def test_a_process_that_cannot_be_started_is_an_answer(
    task: IslandTask, worker: WorkerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: object, **named: object) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    with monkeypatch.context() as patched:
        patched.setattr(subprocess, "Popen", full)
        worker.begin(task)
        assert worker.is_ready()
        assert failed(worker).reason == "the process that adjusts the map could not be started (Cannot allocate memory)"
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)


def test_a_process_that_stands_still_is_given_up(task: IslandTask) -> None:
    worker = WorkerProcess(most_s=0.5)
    worker.begin(task)
    signalled(worker, signal.SIGSTOP)
    assert worker.result() == WorkerFailed("the map was not adjusted within 0.5 s")
    assert worker._child is None


def test_closing_ends_the_process_whatever_it_does(task: IslandTask, worker: WorkerProcess) -> None:
    worker.begin(task)
    process = process_of(worker)
    worker.close()
    assert process._process.returncode == -signal.SIGKILL


def test_an_answer_is_never_taken_for_that_to_another_task(task: IslandTask, worker: WorkerProcess) -> None:
    """Whatever came of the first, it may be asked for the second at once, and again."""
    worker.begin(replace(task, root=99))
    worker.begin(task)
    found = worker.result()
    assert isinstance(found, AdjustedIsland)
    assert worker.result() is found


SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@pytest.mark.long
@pytest.mark.parametrize("sign", [*map(thorough, SIGNALS[:-1]), SIGNALS[-1]])
def test_a_closed_terminal_loses_no_running_adjustment(
    task: IslandTask, worker: WorkerProcess, sign: signal.Signals
) -> None:
    """The process that adjusts died of SIGHUP, while all others left such signals to the program."""
    worker.begin(task)
    signalled(worker, sign)  # while it starts, before it has said anything about signals
    assert isinstance(worker.result(), AdjustedIsland)
    worker.begin(task)
    signalled(worker, sign)
    assert isinstance(worker.result(), AdjustedIsland)
