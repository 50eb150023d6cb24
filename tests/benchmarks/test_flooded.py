"""The short form of `python -m tests.benchmarks.flood`: real program, real UDP.

A fifth of its rate: whether the kernel must drop datagrams at the full one depends on how busy the machine is.
"""

from pathlib import Path

import pytest

from tests.benchmarks.flood import flood
from tests.running import six_pictures

pytestmark = pytest.mark.long


def test_a_flood_of_triggers_loses_no_real_shot(tmp_path: Path, world_cache: Path) -> None:
    outcome = flood(tmp_path, 3.0, 1000, six_pictures(world_cache))
    assert outcome.matched == outcome.shots >= 3
    assert outcome.sent > 1500
    assert 10 <= outcome.recorded <= 100
