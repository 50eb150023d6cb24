"""Writing files that another program may be reading, on a disk that may be full."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gcs_mosaic.store import inside

UNSYNCABLE = (errno.EINVAL, errno.ENOTSUP)  # some network and user-space file systems cannot sync folders
FULL = (errno.ENOSPC, errno.EDQUOT)
# SQLite reports a full disk under its own codes; the second is the shared-memory file of its write-ahead log.
SQLITE_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE)


class CannotWrite(Exception):  # noqa: N818 - names a state, not an error
    """The output folder is not writable now (card removed, mount lost); the same call may be retried later."""


class DiskFull(CannotWrite):
    """The disk is full. Earlier writes are intact, and the same call may be retried later."""


def is_disk_full(error: BaseException) -> bool:
    """Whether the error is the operating system's or SQLite's "disk full"."""
    if isinstance(error, sqlite3.Error):
        return getattr(error, "sqlite_errorcode", None) in SQLITE_FULL
    return isinstance(error, OSError) and error.errno in FULL


@contextmanager
def telling_disk_full(path: Path) -> Iterator[None]:
    """Convert every kind of "no space" error into a `DiskFull` that names `path`."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        if not is_disk_full(error):
            raise
        raise DiskFull(f"the disk is full: free some space, then it goes on ({path} could not be written)") from error


def make_folder(path: Path, root: inside.Root, *, durable: bool = False) -> None:
    """Make a folder below `root` and its parents up to there; `durable` as in `write_beside`. Raises DiskFull, and
    FileNotFoundError without a `root`: below a lost mount there would be another disk."""
    whole = inside.path_of(root)
    with telling_disk_full(path):
        if not whole.is_dir():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(whole))
        for made in inside.make_folder(path, root):
            if durable:
                sync_folder(made.parent)


def write_beside(path: Path, data: bytes, *, durable: bool = False, root: inside.Root | None = None) -> None:
    """Write `data` to `path` atomically: a reader sees the old file or the new one, never a partial one.

    `durable`: survives a power cut, at the cost of a sync: milliseconds, on a memory card up to seconds. A killed process
    loses nothing either way. `root`: the folder below which no link is followed, by default the file's own. Raises DiskFull.
    """
    beside, root = path.with_name(f".{path.name}.part"), root or path.parent
    try:
        with telling_disk_full(path):
            with _begun(beside, root) as file:
                file.write(data)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            inside.move(beside, path, root)
            if durable:
                sync_file(
                    path, root
                )  # on FAT a renamed file's new entry is empty until the file itself is synced again
                sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            inside.remove(beside, root)
        raise


def _begun(beside: Path, root: inside.Root) -> BinaryIO:
    """A new file; what is in its place and no file of ours (a link, a pipe) makes way."""
    new = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    try:
        opened = inside.descriptor(beside, root, new)
    except OSError:
        if inside.status(beside, root) is None or inside.is_file(beside, root):
            raise
        inside.remove(beside, root)
        opened = inside.descriptor(beside, root, new)
    return os.fdopen(opened, "wb")


def identity_of(path: Path) -> tuple[int, int] | None:
    """Device and number of a file or folder; None if it is not there."""
    with suppress(OSError):
        found = path.stat()
        return found.st_dev, found.st_ino
    return None


def sync_file(path: Path, root: inside.Root | None = None) -> None:
    """Wait until a file's content has reached the disk; `root` as in `write_beside`."""
    with inside.reading(path, root or path.parent) as file:
        os.fsync(file.fileno())


def sync_folder(path: Path) -> None:
    """Wait until a folder's entries have reached the disk, where supported (Windows writes them itself)."""
    if os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in UNSYNCABLE:
            raise
    finally:
        os.close(descriptor)


def overwrite(path: Path, data: bytes) -> None:
    """Overwrite the file at `path` in place, which most full disks still allow.

    A reader may briefly see a partial file. Raises DiskFull if `data` is longer than the file, and OSError if there is none.
    """
    opened = inside.descriptor(path, path.parent, os.O_RDWR)
    with telling_disk_full(path), os.fdopen(opened, "r+b", buffering=0) as file:
        file.write(data)
        file.truncate(len(data))
