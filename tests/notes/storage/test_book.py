"""The file of notes through what may happen to its folder."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.search.dismissed_hints import DismissedHints
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.schema import NOTES, VERSION
from gcs_mosaic.store.disk import CannotWrite, DiskFull
from gcs_mosaic.store.folder import NOTES_NAME
from tests.notes.mapped import MappedFlight


def hints(book: NotesBook) -> list[object]:
    return [one.hint for one in DismissedHints(book).all()]


def on_disk(root: Path) -> list[str]:
    with closing(sqlite3.connect(root / NOTES_NAME)) as found:
        return [str(row[0]) for row in found.execute("SELECT hint FROM dismissed ORDER BY hint")]


def test_looking_makes_no_file_and_the_first_note_makes_a_durable_one(book: NotesBook) -> None:
    assert (hints(book), book.revision) == ([], 0)
    assert not book.path.exists()
    DismissedHints(book).dismiss("a", "Kim")
    assert (on_disk(book.root), book.revision) == (["a"], 1)
    with closing(sqlite3.connect(book.path)) as found:
        assert found.execute("PRAGMA application_id").fetchone()[0] == NOTES.application
        assert found.execute("PRAGMA user_version").fetchone()[0] == VERSION
    with book.change(counts=False) as file:
        assert file._opened().execute("PRAGMA synchronous").fetchone()[0] == 3  # EXTRA


def test_a_file_that_is_deleted_comes_back_by_itself(book: NotesBook) -> None:
    DismissedHints(book).dismiss("a", "Kim")
    book.path.unlink()
    book.keep()
    assert on_disk(book.root) == ["a"]
    book.path.unlink()
    DismissedHints(book).dismiss("b", "Kim")
    assert on_disk(book.root) == ["a", "b"]


def test_a_folder_that_is_away_is_waited_for_and_nothing_is_lost(book: NotesBook, tmp_path: Path) -> None:
    DismissedHints(book).dismiss("a", "Kim")
    book.root.rename(tmp_path / "away")
    with pytest.raises(CannotWrite):
        DismissedHints(book).dismiss("b", "Kim")
    assert hints(book) == ["a"]
    book.root.mkdir()
    with pytest.raises(CannotWrite, match="gone, or another flight's"):  # the flight comes first
        book.keep()
    book.root.rmdir()
    (tmp_path / "away").rename(book.root)
    (book.root / NOTES_NAME).unlink()
    DismissedHints(book).dismiss("b", "Kim")
    assert on_disk(book.root) == ["a", "b"]


def test_notes_of_another_flight_are_left_as_they_are(book: NotesBook, tmp_path: Path) -> None:
    other_root = tmp_path / "other"
    other_root.mkdir()
    other = NotesBook(MappedFlight(other_root).root)
    DismissedHints(other).dismiss("theirs", "Lou")
    other.close()
    DismissedHints(book).dismiss("ours", "Kim")
    (other_root / NOTES_NAME).replace(book.path)
    with pytest.raises(CannotWrite, match="not this flight's, and left as it is"):
        DismissedHints(book).dismiss("more", "Kim")
    assert (hints(book), on_disk(book.root)) == (["ours"], ["theirs"])
    book.path.unlink()
    book.keep()
    assert on_disk(book.root) == ["ours"]


def test_an_older_copy_is_replaced(book: NotesBook, tmp_path: Path) -> None:
    DismissedHints(book).dismiss("a", "Kim")
    shutil.copyfile(book.path, tmp_path / "copy")
    DismissedHints(book).dismiss("b", "Kim")
    (tmp_path / "copy").replace(book.path)
    book.keep()
    assert on_disk(book.root) == ["a", "b"]


def test_two_programs_write_and_each_has_what_the_other_wrote(book: NotesBook) -> None:
    other = NotesBook(book.root)
    for hint, one in (("a", book), ("b", other), ("c", book), ("d", other)):
        DismissedHints(one).dismiss(hint, "Kim")
    book.path.unlink()
    other.keep()
    book.keep()
    DismissedHints(book).dismiss("e", "Kim")
    assert hints(other) == hints(book) == on_disk(book.root) == list("abcde")
    assert book.revision == other.revision == 5
    other.close()


def test_a_full_disk_changes_nothing(book: NotesBook) -> None:
    dismissed = DismissedHints(book)
    dismissed.dismiss("a", "Kim")
    with book.change(counts=False) as file:
        pages = file._opened().execute("PRAGMA page_count").fetchone()[0]
        file._opened().execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(DiskFull), book.change() as file:
        file.write("INSERT INTO dismissed VALUES ('b', ?, 0)", "x" * 50_000)
    assert (hints(book), on_disk(book.root), book.revision) == (["a"], ["a"], 1)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (f"PRAGMA user_version = {VERSION + 1}", rf"newer gcs-mosaic \(notes version {VERSION + 1}"),
        ("PRAGMA application_id = 7", "belongs to another program"),
    ],
)
def test_a_file_of_others_is_refused_in_one_sentence_and_left_alone(book: NotesBook, spoil: str, said: str) -> None:
    DismissedHints(book).dismiss("a", "Kim")
    book.close()
    with closing(sqlite3.connect(book.path)) as found:
        found.execute(spoil)
    before = book.path.read_bytes()
    with pytest.raises(UsageError, match=said):
        DismissedHints(NotesBook(book.root)).dismiss("b", "Kim")
    assert book.path.read_bytes() == before
