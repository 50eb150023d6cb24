"""What a check says of the notes, and that a repair leaves them alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.check.check import check, repair
from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.check.notes import check_notes
from gcs_mosaic.notes.search.dismissed_hints import DismissedHints
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import LEDGER_NAME, NOTES_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FlightRecord


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name="f", started_utc=1.0))
    book = NotesBook(tmp_path)
    for number in range(300):
        DismissedHints(book).dismiss(f"hint{number}", "Kim")
    book.close()
    return tmp_path


def test_sound_notes_are_counted(flight: Path) -> None:
    part = CheckedPart("notes", "notes")
    check_notes(flight, part)
    assert (part.checked, part.faults) == (300, [])
    assert check(flight, lambda *_: None).parts[-1] == part


def test_damaged_notes_are_a_fault_and_a_repair_leaves_them_as_they_are(flight: Path) -> None:
    path = flight / NOTES_NAME
    data = bytearray(path.read_bytes())
    data[4096 * 3 : 4096 * 5] = b"\xff" * 8192
    path.write_bytes(data)
    findings = repair(flight, lambda *_: None)
    assert [fault.subject for fault in findings.parts[-1].faults] == [NOTES_NAME]
    assert path.read_bytes() == data


def test_a_flight_without_notes_is_whole(tmp_path: Path) -> None:
    part = CheckedPart("notes", "notes")
    check_notes(tmp_path, part)
    assert (part.checked, part.faults, part.notes) == (0, [], ["there are none"])
