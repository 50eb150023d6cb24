"""The ledger's SQLite file: transactions and detection of a full disk."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs_mosaic.store.disk import sync_file, telling_disk_full
from gcs_mosaic.store.schema import connect, connect_for_reading


class LedgerFile:
    """One SQLite file that holds a flight. Use it only from the thread that opened it."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the ledger at `path`; create it if missing (unless `read_only`). Raises UsageError and DiskFull."""
        self.path = path
        self._connection = connect_for_reading(path) if read_only else connect(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._connection.close()

    def make_durable(self) -> None:
        """Sync all committed changes to disk; callable from any thread. Raises DiskFull and OSError.

        With `synchronous = NORMAL` SQLite itself syncs only at a checkpoint of its write-ahead log.
        """
        log = self.path.with_name(f"{self.path.name}-wal")
        with telling_disk_full(self.path), suppress(FileNotFoundError):  # without a log everything is in the main file
            sync_file(log)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit all changes inside together, or none. Nested transactions are part of the outer one."""
        if self._connection.in_transaction:
            yield
            return
        with telling_disk_full(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._connection.execute("COMMIT")
            finally:
                # SQLite rolls back by itself on some errors (a full disk), not on others.
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")

    def write(self, sql: str, *values: object) -> int:
        """Run one statement; returns the id of the inserted row."""
        with telling_disk_full(self.path):
            return self._connection.execute(sql, values).lastrowid or 0

    def changed(self, sql: str, *values: object) -> int:
        """Run one statement; returns the number of changed rows."""
        with telling_disk_full(self.path):
            return self._connection.execute(sql, values).rowcount

    def update(self, sql: str, *values: object) -> None:
        """Change exactly one row, identified by the last value. Raises LookupError if there is none."""
        if self.changed(sql, *values) != 1:
            raise LookupError(f"nothing of that name in {self.path}: {values[-1]!r}")

    def rows(self, sql: str, *values: object) -> list[sqlite3.Row]:
        return self._connection.execute(sql, values).fetchall()
