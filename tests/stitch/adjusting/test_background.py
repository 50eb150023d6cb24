"""A process of its own gives the same answer, and its death is an answer too."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, photograph

from gcs_mosaic.stitch.adjusting.adjustment import AdjustmentSettings
from gcs_mosaic.stitch.adjusting.background import Failed, WorkerProcess
from gcs_mosaic.stitch.adjusting.solving import AdjustedIsland, adjusted, island_task
from gcs_mosaic.stitch.geometry import Pose
from gcs_mosaic.stitch.mosaic import Mosaic


@pytest.fixture(scope="module")
def task(ground):
    mosaic = Mosaic()
    for i in range(6):
        mosaic.add(photograph(ground, Pose(400 + 130 * i, 500, 0.01 * i, 0.05, 0.03), SMALL_CAMERA), str(i))
    return island_task(mosaic._network, 0, AdjustmentSettings())


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


def test_a_process_that_is_killed_is_told_and_begun_anew(task, worker):
    worker.begin(task)
    os.kill(worker._process.pid, signal.SIGKILL)
    assert worker.result() == Failed("the process that adjusts the map has died")
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
