"""Writing where another program may be reading, on a disk that may be full."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
# SQLite reports a full disk under its own codes; the second is the shared-memory file of its write-ahead log.
SQLITE_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE)


class CannotWrite(Exception):  # noqa: N818 - it says what is, not that somebody erred
    """The output folder takes nothing now (a card pulled out, a mount lost); the same call may be tried again later."""


class DiskFull(CannotWrite):
    """Nothing more fits on the disk. What was written before is whole, and the same call may be tried again later."""


def is_disk_full(error: BaseException) -> bool:
    """Whether this is the operating system's or SQLite's way to say that nothing more fits."""
    if isinstance(error, sqlite3.Error):
        return getattr(error, "sqlite_errorcode", None) in SQLITE_FULL
    return isinstance(error, OSError) and error.errno in FULL


@contextmanager
def telling_disk_full(path: Path) -> Iterator[None]:
    """Turn every way of saying "no space" into one `DiskFull` that names `path`."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        if not is_disk_full(error):
            raise
        raise DiskFull(f"the disk is full, {path} could not be written: free some space, then it goes on") from error


def make_folder(path: Path) -> None:
    """Make a folder and those above it. Raises DiskFull."""
    with telling_disk_full(path):
        path.mkdir(parents=True, exist_ok=True)


def write_beside(path: Path, data: bytes) -> None:
    """Write `data` to `path` so that a reader finds the old file or the new one, never half of one.

    There is no fsync: a killed process loses nothing that it has handed to the operating system, everything written
    this way can be made again from the ledger and the originals after a power cut, and waiting for the disk would stall
    the newest frame by up to seconds on a memory card. Raises DiskFull.
    """
    beside = path.with_name(f".{path.name}.part")
    try:
        with telling_disk_full(path):
            beside.write_bytes(data)
            beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def overwrite(path: Path, data: bytes) -> None:
    """Write `data` into the space that the file at `path` has already, which most full disks still allow.

    A reader may find half of it for a moment. Raises DiskFull if it is longer than the file, and OSError without a file.
    """
    with telling_disk_full(path), path.open("r+b", buffering=0) as file:
        file.write(data)
        file.truncate(len(data))
