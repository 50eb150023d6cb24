"""A copy of a flight's ledger to look into: a check changes nothing, and opening a ledger would."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.foreign_file import ForeignFile, refuse_strange_files
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.schema import VERSION, DamagedLedger, connect_for_reading, version_of

BESIDE = ("", "-wal")  # the ledger's files; what else SQLite needs it makes itself


@contextmanager
def ledger_copy(flight: Path, *, written: bool) -> Iterator[tuple[Ledger, int] | DamagedLedger]:
    """The ledger as it is now, in the present schema, and the version of its schema; or why it cannot be read.

    `written`: another program has it open. Raises UsageError for a ledger of a newer version, or of another program.
    """
    with TemporaryDirectory(prefix="gcs-mosaic-check-", ignore_cleanup_errors=True) as scratch:
        copy = Path(scratch) / LEDGER_NAME
        opened = _opened(flight, copy, written=written)
        if isinstance(opened, DamagedLedger):
            yield opened
            return
        with opened[0]:
            yield opened


def _opened(flight: Path, copy: Path, *, written: bool) -> tuple[Ledger, int] | DamagedLedger:
    try:
        refuse_strange_files(flight / LEDGER_NAME)
        (_backed_up if written else _copied)(flight / LEDGER_NAME, copy)
        with closing(sqlite3.connect(copy, factory=ForeignFile)) as connection:
            version = version_of(connection, flight / LEDGER_NAME)
        ledger = Ledger(copy)
    except DamagedLedger as error:
        return error
    except FileNotFoundError:
        return DamagedLedger(f"{flight / LEDGER_NAME} does not exist")
    except sqlite3.DatabaseError as error:
        return DamagedLedger(f"{flight / LEDGER_NAME} cannot be read ({error})")
    except OSError as error:
        raise UsageError(f"{flight / LEDGER_NAME} cannot be copied to look into it ({error})") from error
    problem = integrity_problem(ledger)
    if problem is None:
        return ledger, version or VERSION
    ledger.close()
    return DamagedLedger(f"{flight / LEDGER_NAME} is damaged ({problem})")


def integrity_problem(ledger: Ledger) -> str | None:
    """What SQLite itself finds wrong with the file; None if nothing."""
    try:
        found = [str(row[0]) for row in ledger.rows("PRAGMA integrity_check(3)")]
    except DamagedLedger as error:
        return str(error.__cause__)
    return None if found == ["ok"] else " ".join(found).replace("\n", " ")


def _copied(path: Path, copy: Path) -> None:
    for suffix in BESIDE:
        source = path.with_name(path.name + suffix)
        if suffix == "" or inside.exists(source, path.parent):
            with inside.reading(source, path.parent) as old, copy.with_name(copy.name + suffix).open("wb") as new:
                shutil.copyfileobj(old, new)


def _backed_up(path: Path, copy: Path) -> None:
    """A consistent copy of a ledger that is being written."""
    with closing(connect_for_reading(path)) as source, closing(sqlite3.connect(copy)) as target:
        source.backup(target)
