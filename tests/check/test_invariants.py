"""What must hold between the rows of a ledger: each contradiction is found, and settled so that nothing contradicts any more."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.check.invariants import check_rows, settle_rows
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from tests.store.ledger_parts import NEARLY_THE_SAME, a_frame, a_painted, an_estimate, an_event, forget_painted

# By what is done to the ledger: what is found, and the states of a.jpg, which is placed, and b.jpg, which it covers.
CONTRADICTIONS = {
    "DELETE FROM estimates": ("the ledger has no place for it", "pending", "covered"),
    "DELETE FROM painted": ("placed, but not painted", "pending", "covered"),
    "DELETE FROM covered": ("nothing says by which frame", "placed", "pending"),
    "UPDATE frames SET state = 'waiting' WHERE name = 'a.jpg'": ("painted, but not placed", "waiting", "covered"),
    "UPDATE frames SET state = 'waiting' WHERE name = 'b.jpg'": (
        "has a keyframe, but is not covered",
        "placed",
        "waiting",
    ),
    "DELETE FROM islands": ("not in the list of islands", "placed", "covered"),
    "DELETE FROM cameras": ("refers to a row that does not exist", "pending", "covered"),
    "DELETE FROM flight": ("the row that names the flight", "placed", "covered"),
    "UPDATE flight SET canvas = '{'": ("the row that names the flight", "placed", "covered"),
    "UPDATE painted SET gain = x'00'": ("its row in the table painted cannot be read", "pending", "covered"),
    "UPDATE estimates SET homography = x'00'": ("in the table estimates", "pending", "covered"),
    "INSERT INTO islands VALUES (5, 6), (6, 5)": ("merged into itself", "placed", "covered"),
    "UPDATE events SET frame = 99": ("refers to a row that does not exist", "placed", "covered"),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A ledger in which everything is as it should be."""
    path = tmp_path / LEDGER_NAME
    with Ledger(path) as ledger:
        ledger.begin_flight(FlightRecord(name="flight", started_utc=1.0))
        ledger.record_island(0)
        for name in ("a.jpg", "b.jpg", "c.jpg"):
            ledger.record_frame(a_frame(name))
            ledger.record_original(name, f"frames/{name}")
            ledger.record_size(name, 4, 3)
        ledger.settle_event(ledger.record_event(an_event()), EventState.MATCHED, frame="a.jpg")
        ledger.settle_frame("a.jpg", FrameState.PLACED)
        ledger.record_estimates([an_estimate(Pose(0.0, 0.0, 0.0))])
        ledger.record_painted(a_painted())
        ledger.settle_frame("b.jpg", FrameState.COVERED)
        ledger.record_covered("b.jpg", "a.jpg", NEARLY_THE_SAME)
    return path


def found_in(ledger: Ledger) -> CheckedPart:
    part = CheckedPart("ledger", "frames")
    check_rows(ledger, part)
    return part


def test_nothing_is_found_where_nothing_is_wrong(path: Path) -> None:
    with Ledger(path) as ledger:
        part = found_in(ledger)
        assert (part.checked, part.faults) == (3, [])
        assert part.notes == ["1 frames are still to be placed: gcs-mosaic --resume, or stitch"]


@pytest.mark.parametrize("statement", CONTRADICTIONS)
def test_a_contradiction_is_found_and_settled(path: Path, statement: str) -> None:
    said, *states = CONTRADICTIONS[statement]
    with sqlite3.connect(path) as other:
        other.execute(statement)
    other.close()
    with Ledger(path) as ledger:
        assert said in " ".join(fault.text for fault in found_in(ledger).faults)
        settle_rows(ledger, "name", 2.0)
        assert found_in(ledger).faults == []
        assert [str(frame.state) for frame in ledger.frames()] == [*states, "pending"]


def test_a_frame_whose_original_is_not_kept_may_be_placed_without_being_painted(path: Path) -> None:
    with Ledger(path) as ledger:
        forget_painted(ledger, "a.jpg")
        ledger.write("UPDATE frames SET original = NULL")
        assert found_in(ledger).faults == []


def test_what_cannot_be_settled_leaves_the_ledger_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is one transaction."""
    monkeypatch.setattr("gcs_mosaic.check.invariants._unreadable", lambda ledger: 1 / 0)
    with Ledger(path) as ledger:
        ledger.write("DELETE FROM painted")
        with pytest.raises(ZeroDivisionError):
            settle_rows(ledger, "name", 2.0)
        assert len(ledger.frames(FrameState.PLACED)) == 1
