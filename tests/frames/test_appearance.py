"""Files that a late scan finds are dated by their own times, on whatever clock those are."""

from __future__ import annotations

import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.appearance import Appearances, Pause
from gcs_mosaic.frames.directory import FolderWatch
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import Frame

UTC = 1.75e9


@pytest.mark.parametrize("off", [0.0, -7200.0, 1e6])
def test_the_cameras_clock_may_be_off(off: float) -> None:
    appearances = Appearances()
    for k in range(5):
        appearances.dated(Pause(k, k + 0.1), UTC + off + k, k + 0.2, UTC)
    assert appearances.dated(Pause(10.0, 30.0), UTC + off + 17.0, 30.1, UTC) == pytest.approx(17.2)


def test_a_time_outside_the_pause_says_nothing() -> None:
    assert Appearances().dated(Pause(10.0, 30.0), UTC + 5.0, 30.1, UTC) == 30.1
    assert Appearances().dated(Pause(10.0, 30.0), UTC + 17.0, 30.1, UTC) == pytest.approx(17.0)


def test_files_of_a_pause_have_their_own_times_and_those_found_in_time_have_theirs(tmp_path: Path) -> None:
    watched, now = FolderWatch(tmp_path, FolderSettings(), time.time(), None), time.monotonic() - 30.0
    list(watched.poll(now))
    list(watched.poll(now + 0.1))
    utc_of_zero = time.time() - time.monotonic()
    for k in range(3):
        path = tmp_path / f"{k}.jpg"
        cv2.imwrite(str(path), np.full((48, 64, 3), 50 * k, np.uint8))
        os.utime(path, (0, utc_of_zero + now + 5.0 + k))
    found = [*watched.poll(now + 30.0), *watched.poll(now + 30.1)]
    assert [one.received - now for one in found if isinstance(one, Frame)] == pytest.approx([5.0, 6.0, 7.0], abs=0.1)
