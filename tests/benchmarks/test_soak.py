"""A flight around which everything goes wrong ends as one that nothing happened to."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.benchmarks.mischief import ALL, full_disk
from tests.benchmarks.soak import soaked

MINUTES = 1.0  # or until everything has happened once


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.skipif(sys.platform != "linux", reason="signals, /proc and mounts of Linux")
def test_a_flight_with_everything_against_it_is_whole(tmp_path: Path) -> None:
    found = soaked(MINUTES, 1, tmp_path)
    assert found.faults == []
    # Who may not mount a small disk cannot fill it.
    assert {one.__name__ for one in ALL} - found.done.keys() <= {full_disk.__name__}
