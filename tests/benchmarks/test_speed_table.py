"""What is compared of two rows, what is chance, and what is kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmarks.floors import Floor
from tests.benchmarks.speed_costs import Costs, in_floors
from tests.benchmarks.speed_table import Row, begun, keep, last_like, lines, median, page_rows, read, slower

COSTS = Costs(0.4, wall=3.0, cpu=4.0, resident_mb=800.0, stages={"place": 1.0, "paint": 2.0, "ledger": 0.01})
ROW = Row(
    flight="meadow",
    frames=20,
    repeats=3,
    day="2026-11-26",
    commit="0123456789",
    cores=2,
    processor="a processor",
    load=0.1,
    scales={"50%": COSTS},
)


def with_stages(**stages: float) -> Row:
    return replace(ROW, scales={"50%": replace(COSTS, stages=COSTS.stages | stages)})


def test_a_stage_slower_by_more_than_a_tenth_is_named() -> None:
    assert slower(with_stages(paint=2.0 * 1.11), ROW) == ["SLOWER at 50%: paint 2.00 -> 2.22 floors a frame"]
    assert slower(with_stages(paint=2.0 * 1.09), ROW) == []
    assert slower(with_stages(paint=1.0), ROW) == []


def test_a_stage_or_a_scale_that_is_missing_is_said() -> None:
    gone = replace(ROW, scales={"50%": replace(COSTS, stages={"place": 1.0, "ledger": 0.01})})
    assert slower(gone, ROW) == ["SLOWER at 50%: paint is missing, it was 2.00 floors a frame"]
    assert slower(replace(ROW, scales={}), ROW) == ["SLOWER at 50%: not measured now"]


def test_what_is_next_to_nothing_may_double_and_a_new_stage_may_come() -> None:
    assert slower(with_stages(ledger=0.02, connect=0.5), ROW) == []
    assert slower(with_stages(ledger=0.05), ROW) == ["SLOWER at 50%: ledger 0.01 -> 0.05 floors a frame"]


def test_the_clock_counts_only_on_a_machine_with_nothing_else_to_do() -> None:
    late = replace(ROW, scales={"50%": replace(COSTS, wall=4.0)})
    assert slower(late, ROW) == ["SLOWER at 50%: wall 3.00 -> 4.00 floors a frame"]
    assert slower(replace(late, load=3.0), ROW) == slower(late, replace(ROW, load=3.0)) == []
    assert slower(replace(late, cores=1), ROW) == []
    assert slower(replace(ROW, load=3.0, scales={"50%": replace(COSTS, cpu=4.5)}), ROW) == [
        "SLOWER at 50%: all cores 4.00 -> 4.50 floors a frame"
    ]


def test_seconds_are_told_in_floors_by_the_same_clock() -> None:
    floor = Floor(decode=0.1, warp=0.2, encode=0.1, cpu=0.2)
    found = in_floors(floor, 10, 8.0, 6.0, 700.0, {"place": 1.0})
    assert (found.floor_s, found.wall, found.cpu) == pytest.approx((0.4, 2.0, 3.0))
    assert found.stages == pytest.approx({"place": 0.5})


def test_each_figure_has_a_median_of_its_own() -> None:
    runs = [replace(COSTS, wall=wall, stages={"place": 4.0 - wall}) for wall in (1.0, 2.0, 3.0)]
    found = median([*runs, replace(COSTS, wall=9.0, stages={}), replace(COSTS, wall=9.0, stages={})])
    assert (found.wall, found.stages) == (3.0, {"place": 1.0})


def test_rows_are_kept_and_compared_with_the_last_of_the_same_frames(tmp_path: Path) -> None:
    file, newer = tmp_path / "speed.json", replace(ROW, day="2026-11-27")
    assert read(file) == []
    for row in (ROW, newer, replace(ROW, frames=4), replace(ROW, flight="heath")):
        keep(file, row)
    assert last_like(read(file), ROW) == newer
    assert last_like(read(file), replace(ROW, frames=5)) is None
    assert [cells[2] for cells in page_rows(file)] == ["20", "4", "20", "20"]


def test_a_row_tells_day_commit_and_machine() -> None:
    row = replace(begun("meadow", 20, 3), scales=ROW.scales)
    head, costs = lines(row)
    assert f"{row.day}, commit {row.commit}, {row.cores} cores of {row.processor}, load {row.load:.1f} before" in head
    assert "50%: 3.00 floors a frame by the clock, 4.00 of all cores, 800 MB" in costs
    assert costs.endswith("paint 2.00, place 1.00, ledger 0.01")
