"""The short forms of `python -m tests.benchmarks.suspended` and `… forgers`: real program, real UDP, real SIGSTOP."""

from pathlib import Path

import pytest

from tests.benchmarks.forgers import outcome
from tests.benchmarks.suspended import over_udp
from tests.running import six_pictures

pytestmark = pytest.mark.long


@pytest.mark.thorough
def test_a_program_that_stood_still_dates_triggers_by_their_arrival(tmp_path: Path, world_cache: Path) -> None:
    assert over_udp(tmp_path, six_pictures(world_cache), stopped_s=4.0, shots=9) >= 8


@pytest.mark.thorough
def test_forged_counters_ahead_of_the_cameras_take_no_picture(tmp_path: Path, world_cache: Path) -> None:
    own, rows, sent, said = outcome(tmp_path, "numbered", "counters", six_pictures(world_cache), 10)
    assert own >= 9, said
    assert rows <= sent == 39
