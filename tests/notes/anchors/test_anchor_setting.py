"""`anchor: positions`: asked for in the notes, where nobody has decided."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from gcs_mosaic.notes.anchors.anchor_setting import let_positions_lay
from gcs_mosaic.notes.anchors.pins import Pins
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import NOTES_NAME


def asked(root: Path) -> bool | None:
    with closing(NotesBook(root)) as book:
        return Pins(book).asked_for_positions


def test_positions_are_asked_for_once(tmp_path: Path) -> None:
    assert asked(tmp_path) is None
    assert let_positions_lay(tmp_path).level == "info"
    assert asked(tmp_path) is True
    assert "lay the map on earth" in let_positions_lay(tmp_path).text


def test_what_somebody_has_decided_stays(tmp_path: Path) -> None:
    with closing(NotesBook(tmp_path)) as book:
        Pins(book).ask_for_positions("Kim", asked=False)
    assert "switched that off" in let_positions_lay(tmp_path).text
    assert asked(tmp_path) is False


def test_notes_that_cannot_be_written_do_not_stop_a_flight(tmp_path: Path) -> None:
    (tmp_path / NOTES_NAME).write_bytes(b"something else, longer than a page's head " * 30)
    notice = let_positions_lay(tmp_path)
    assert notice.level == "warning"
    assert "ask for it on the page" in notice.text
    assert let_positions_lay(tmp_path / "gone").level == "warning"
