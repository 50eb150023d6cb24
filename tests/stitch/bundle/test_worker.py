"""A process of its own gives the same answer, and its death is an answer too."""

import logging
import os
import re
import signal
from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, photograph

from gcs_mosaic.stitch.bundle.island import AdjustedIsland, adjusted, island_task
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.worker import Failed, WorkerProcess
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.mosaic import Mosaic


@pytest.fixture(scope="module")
def task(ground):
    mosaic = Mosaic()
    for i in range(6):
        mosaic.add(photograph(ground, Pose(400 + 130 * i, 500, 0.01 * i, 0.05, 0.03), SMALL_CAMERA), str(i))
    return island_task(mosaic._graph, 0, AdjustmentSettings())


def unreadable():
    raise ValueError("this is no task")


class Unreadable:
    """Breaks whoever unpacks it."""

    def __reduce__(self):
        return unreadable, ()


@pytest.fixture
def worker():
    worker = WorkerProcess()
    yield worker
    worker.close()


def test_it_finds_what_would_be_found_here(task, worker):
    worker.begin(task)
    there, here = worker.result(), adjusted(task)
    assert isinstance(there, AdjustedIsland)
    assert np.abs(here.poses - task.problem.poses).max() > 1e-3
    for name in ("poses", "lenses", "residuals", "deviations_px"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-6)


def test_a_task_that_breaks_is_told_and_the_next_one_is_done(task, worker):
    worker.begin(replace(task, root=99))
    broken = worker.result()
    assert isinstance(broken, Failed)
    assert "IndexError" in broken.reason
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)


def test_the_traceback_of_the_other_process_is_in_the_log(task, worker, caplog):
    worker.begin(replace(task, root=99))
    broken = worker.result()
    assert broken.traceback.startswith("Traceback (most recent call last):\n")
    assert re.search(r'bundle/island\.py", line \d+, in adjusted\n', broken.traceback)
    (record,) = caplog.records
    assert (record.levelname, record.getMessage()) == ("ERROR", broken.reason)
    assert broken.traceback in logging.Formatter().format(record)


def test_a_task_that_cannot_be_read_is_told_and_the_next_one_is_done(task, worker, capfd):
    worker.begin(Unreadable())
    broken = worker.result()
    assert "this is no task" in broken.reason
    assert "in unreadable" in broken.traceback
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)
    assert capfd.readouterr().err == ""


def test_a_process_that_is_killed_is_told_and_begun_anew(task, worker, caplog):
    worker.begin(task)
    os.kill(worker._process.pid, signal.SIGKILL)
    assert worker.result() == Failed("the process that adjusts the map has died")
    assert caplog.messages == ["the process that adjusts the map has died, exit code -9"]
    worker.begin(task)
    assert isinstance(worker.result(), AdjustedIsland)


def test_a_process_that_stands_still_is_given_up(task):
    worker = WorkerProcess(most_s=0.5)
    worker.begin(task)
    os.kill(worker._process.pid, signal.SIGSTOP)
    assert worker.result() == Failed("the map was not adjusted within 0.5 s")
    assert worker._process is None


def test_closing_ends_the_process_whatever_it_does(task, worker):
    worker.begin(task)
    process = worker._process
    worker.close()
    assert not process.is_alive()


def test_an_answer_is_never_taken_for_that_to_another_task(task, worker):
    """Whatever came of the first, it may be asked for the second at once, and again."""
    worker.begin(replace(task, root=99))
    worker.begin(task)
    found = worker.result()
    assert isinstance(found, AdjustedIsland)
    assert worker.result() is found
