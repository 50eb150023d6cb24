"""Power cuts on a real block device; a hundred of them: tests/benchmarks/power_cuts.py."""

from __future__ import annotations

import pytest

from tests.benchmarks.power_cuts import cannot, cuts


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.parametrize(("kind", "count"), [("ext4", 3), ("vfat", 1)])
def test_a_power_cut_loses_nothing_that_is_older_than_a_second(kind: str, count: int) -> None:
    if why := cannot(kind):
        pytest.skip(why)
    found = list(cuts(count, kind))
    assert [cut for cut in found if not cut.harmless] == []
    assert count == 1 or any(cut.frames > 5 for cut in found)  # how many are placed by then depends on the machine
