"""Killed again and again, the flight is whole in the end; two hundred times: tests/benchmarks/kills.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks.kills import survived


@pytest.mark.thorough
@pytest.mark.long
def test_a_flight_that_is_killed_again_and_again_is_whole_in_the_end(tmp_path: Path) -> None:
    assert survived(kills=4, frames=10, folder=tmp_path, seed=1).whole
