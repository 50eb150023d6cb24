"""The tables of the paper: whoever takes too long is stopped, breaks are told, placements are those that are painted."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import sitl.flight
from sitl.path import Plan
from tests.benchmarks.contestants import STAGES, painted_from_source
from tests.benchmarks.paper_tables import Flight, Run, remark, run, table_2

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flight:
    folder = tmp_path_factory.mktemp("flight")
    route = Plan(frames=3, height=60)
    sitl.flight.make("survey", folder, (640, 480), cache=world_cache, seed=3, world_size=2048, route=route)
    return Flight(folder)


@pytest.mark.thorough
def test_the_first_stitch_is_judged_by_the_truth(flight: Flight) -> None:
    found = run(Run("paper", flight.frames[:2], 0.5), limit=120)
    cells = flight.cells(found, 120)
    total, features, matching, stitching = map(float, cells[:4])
    assert total == pytest.approx(features + matching + stitching, abs=0.02)
    seconds = found["last"] if found["first"] else found["seconds"]
    assert min(seconds[stage] for stage in STAGES) > 0  # the cells are rounded, and an idle machine is fast
    assert int(cells[4]) > 100
    assert cells[5] == "2"
    assert float(cells[6]) < 3
    assert cells[8] == ""


@pytest.mark.thorough
def test_whoever_takes_too_long_is_stopped(flight: Flight) -> None:
    found = run(Run("adjusted", flight.frames, 1.0), limit=0.2)
    assert found["code"] is None
    assert flight.cells(found, 0.2)[5:] == ["-", "-", "-", "stopped after 0 s"]


def test_a_failure_is_told_with_its_last_words(flight: Flight) -> None:
    found = run(Run("paper", flight.frames[:1], 0.3), limit=60)
    assert found["code"] == 1
    assert "scale: expected 1, 0.5 or 0.25" in remark(found, 60)


def test_a_recipe_that_breaks_tells_at_which_frame() -> None:
    found = {"remark": "", "code": 0, "refused": [(4, "too large"), (5, "too few matches")]}
    assert remark(found, 60) == "breaks at frame 4 (too large); 2 refused"


def test_a_table_has_a_row_for_each_feature_and_method(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Run] = []
    found = {"refused": [], "remark": "", "code": 0, "first": True}

    def note(wanted: Run, limit: float) -> dict[str, object]:
        asked.append(wanted)
        return found

    monkeypatch.setattr("tests.benchmarks.paper_tables.run", note)
    rows = list(table_2([flight], 0.5, 60))
    assert len(rows) == len(asked) == 9
    assert {len(row) for row in rows} == {11}
    assert {len(wanted.frames) for wanted in asked} == {2}


def test_competitors_are_judged_by_what_they_paint() -> None:
    affine = np.array([[0.9, -0.2, 30], [0.2, 0.9, -20], [0, 0, 1]], np.float32)
    picture = np.zeros((200, 300), np.uint8)
    cv2.circle(picture, (210, 60), 6, 255, -1)
    warper = cv2.PyRotationWarper("affine", 1.0)
    corner, warped = warper.warp(picture, np.eye(3, dtype=np.float32), affine, cv2.INTER_LINEAR, cv2.BORDER_CONSTANT)
    y, x = np.nonzero(warped > 127)
    told = cv2.perspectiveTransform(np.array([[[210.0, 60.0]]]), painted_from_source(affine))[0, 0]
    assert told == pytest.approx([x.mean() + corner[0], y.mean() + corner[1]], abs=0.5)
