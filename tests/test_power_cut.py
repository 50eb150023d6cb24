"""Power cuts on a real block device; a hundred of them: tests/benchmarks/power_cuts.py."""

from __future__ import annotations

import pytest

from tests.benchmarks.power_cuts import cannot, cuts


@pytest.mark.long
def test_a_power_cut_loses_nothing_that_is_older_than_a_second() -> None:
    if why := cannot():
        pytest.skip(why)
    found = list(cuts(3))
    assert [cut for cut in found if not cut.harmless] == []
    assert any(cut.placed > 5 for cut in found)
