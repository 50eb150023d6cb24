"""The file of notes, kept through whatever becomes of its folder."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import ClassVar

from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.storage.schema import NOTES
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite, identity_of
from gcs_mosaic.store.folder import LEDGER_NAME, NOTES_NAME
from gcs_mosaic.store.ledger_file import LedgerFile, flight_at
from gcs_mosaic.store.schema import FileSchema, connect_for_reading

logger = logging.getLogger(__name__)

TRIES = 5  # when another program writes at the same moment


class NoSuchNote(LookupError):  # noqa: N818 - names a state, not an error
    """Nothing of that number is there."""


class NotesFile(LedgerFile):
    """One SQLite file of notes, and its copy in memory."""

    schema: ClassVar[FileSchema] = NOTES

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        super().__init__(path, read_only=read_only)
        self._seen = self._commits_of_others()

    @property
    def name(self) -> str:
        return str(self.rows("SELECT name FROM book")[0]["name"])

    @property
    def revision(self) -> int:
        return int(self.rows("SELECT revision FROM book")[0]["revision"])

    @property
    def is_behind(self) -> bool:
        """Whether another program has written to the file since it was read."""
        return self._commits_of_others() != self._seen

    def catch_up(self) -> None:
        """Take in what another program has written. Raises CannotWrite."""
        with self._watched():
            seen = self._commits_of_others()
            self._opened().backup(self._memory)
            self._seen = seen

    def write_anew(self) -> None:
        super().write_anew()
        self._seen = self._commits_of_others()

    def _commits_of_others(self) -> int:
        return int(self._opened().execute("PRAGMA data_version").fetchone()[0])


class NotesBook:
    """What people have added to the flight in a folder. Use it only from the thread that first asks it something.

    The file is made with the first note. Whatever was taken in is held in memory too: a file that is lost is written anew, one
    that another program has written to meanwhile is read again, and one that is not of this flight is left as it is.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.path = root, root / NOTES_NAME
        self._file: NotesFile | None = None
        self._identity: tuple[int, int] | None = None
        self._flight: tuple[str, float] | None = None

    @property
    def revision(self) -> int:
        """Of the last change; 0 without one. Raises as `rows`."""
        file = self._read()
        return 0 if file is None else file.revision

    def rows(self, sql: str, *values: object) -> list[sqlite3.Row]:
        """The rows of a query, none where there are no notes yet. Raises UsageError for a file that cannot be read."""
        file = self._read()
        return [] if file is None else file.rows(sql, *values)

    @contextmanager
    def change(self, *, counts: bool = True) -> Iterator[NotesFile]:
        """All changes inside are on the disk after it, or none is. `counts`: they make a new revision.

        Raises CannotWrite (DiskFull), OSError and UsageError where that cannot be; the same may be tried later.
        """
        file = self._ready()
        with self._settled(file):
            if counts:
                file.write("UPDATE book SET revision = revision + 1")
            yield file

    def keep(self) -> None:
        """Bring back a file that was lost, take in what others wrote; to be called every few seconds. Raises as `change`."""
        if self._file is not None:
            self._ready()

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    @contextmanager
    def _settled(self, file: NotesFile) -> Iterator[None]:
        """A transaction that begins with what others have written."""
        for _ in range(TRIES):
            with file.transaction():
                if not file.is_behind:
                    yield
                    return
            file.catch_up()
        raise CannotWrite(f"{self.path} is written by another program all the time")

    def _read(self) -> NotesFile | None:
        """What is in memory is the newest, but for what another program has written."""
        if self._file is None and inside.exists(self.path, self.root):
            self._open()
        elif self._file is not None:
            try:
                self._ready()
            except (CannotWrite, OSError, UsageError, sqlite3.Error):
                logger.info("the notes in memory are shown", exc_info=True)
        return self._file

    def _ready(self) -> NotesFile:
        if self._file is None:
            self._open()
        assert self._file is not None, "it has just been opened"
        identity = identity_of(self.path)
        if identity != self._identity or self._file.damaged:
            self._take(self._file, identity)
        elif self._file.is_behind:
            self._file.catch_up()
        return self._file

    def _open(self) -> None:
        if not self.root.is_dir():
            raise CannotWrite(f"{self.root} is gone")
        try:
            self._file = NotesFile(self.path)
        except sqlite3.Error as error:
            raise CannotWrite(f"{self.path} cannot be opened ({error})") from error
        self._note()

    def _note(self) -> None:
        self._identity = identity_of(self.path)
        self._flight = self._flight or flight_in(self.root)

    def _take(self, file: NotesFile, identity: tuple[int, int] | None) -> None:
        """Have a file at the path again that holds all that is in memory."""
        if not self.root.is_dir() or (self._flight is not None and flight_in(self.root) != self._flight):
            raise CannotWrite(f"{self.root} is gone, or another flight's")
        there = None if identity in (None, self._identity) else book_at(self.path)
        if identity not in (None, self._identity) and (there is None or there[0] != file.name):
            text = f"the {NOTES_NAME} there is not this flight's, and left as it is: move it away, then it goes on"
            raise CannotWrite(text)
        if there is not None and there[1] >= file.revision:  # another program has brought it back
            opened = NotesFile(self.path)
            file.close()
            self._file = opened
        else:
            file.write_anew()
            logger.warning("%s was written anew: it was lost, damaged or older", self.path)
        self._note()


def flight_in(root: Path) -> tuple[str, float] | None:
    """Name and start of the flight in a folder; None if there is none."""
    return flight_at(root / LEDGER_NAME)


def book_at(path: Path) -> tuple[str, int] | None:
    """Name and revision of the notes in a file; None if there are none that can be read."""
    try:
        with closing(connect_for_reading(path, NOTES)) as found:
            row = found.execute("SELECT name, revision FROM book").fetchone()
            return str(row["name"]), int(row["revision"])
    except (UsageError, sqlite3.Error, TypeError):
        logger.info("%s cannot be read", path, exc_info=True)
        return None
