"""The short form of `python -m tests.benchmarks.flood`: real program, real UDP.

A fifth of its rate: whether the kernel must drop datagrams at the full one depends on how busy the machine is.
"""

from pathlib import Path

import pytest

from tests.benchmarks.flood import flood
from tests.running import six_pictures

pytestmark = pytest.mark.long


@pytest.mark.thorough
def test_a_flood_of_triggers_costs_two_shots_at_most(tmp_path: Path, world_cache: Path) -> None:
    """Those before the camera is known by its files; of 40 shots in a longer one that is a twentieth."""
    outcome = flood(tmp_path, 5.0, 1000, six_pictures(world_cache))
    assert outcome.shots >= 8
    assert outcome.matched >= outcome.shots - 2
    assert outcome.sent > 2500
    assert 10 <= outcome.recorded <= 100
