"""Folder lock: one writing program at a time."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from gcs_mosaic.store import inside

LOCK_NAME = ".gcs-mosaic.lock"


def lock_file(descriptor: int) -> None:
    """Lock the open file without waiting. Raises BlockingIOError (on Windows PermissionError) if another program holds it."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class FolderLock:
    """Holds a folder until `release`, or until the process ends for any reason."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    def holds(self, folder: Path) -> bool:
        """Whether this is the lock of the folder that is at this path now."""
        return self._descriptor is not None and is_still_there(self._descriptor, folder / LOCK_NAME)

    @property
    def is_deleted(self) -> bool:
        """Whether its file was deleted, not moved away or lost with its mount."""
        try:
            return self._descriptor is not None and os.fstat(self._descriptor).st_nlink == 0
        except OSError:  # the disk is gone
            return False

    def move_to(self, folder: Path) -> bool:
        """Hold this folder instead; False if another program holds it. Raises OSError if it cannot be written."""
        new = try_lock(folder)
        if new is None:
            return False
        self.release()
        self._descriptor = new._descriptor
        return True

    def release(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def try_lock(folder: Path) -> FolderLock | None:
    """The folder's lock, or None if another program holds it. Raises OSError if the folder cannot be written."""
    descriptor = inside.descriptor(folder / LOCK_NAME, folder, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lock_file(descriptor)
    except (BlockingIOError, PermissionError):  # the second is raised on Windows
        os.close(descriptor)
        return None
    except OSError:
        # Some network file systems have no locks. Flying without one is better than not flying.
        return FolderLock(descriptor)
    if not is_still_there(descriptor, folder / LOCK_NAME):
        os.close(descriptor)
        return None
    return FolderLock(descriptor)


def is_locked(folder: Path) -> bool:
    """Whether another program writes into the folder now. Nothing is changed, and the lock is held for no longer than asking."""
    try:
        descriptor = inside.descriptor(
            folder / LOCK_NAME, folder, os.O_RDONLY if sys.platform != "win32" else os.O_RDWR
        )
    except OSError:  # there is none, or nobody may write here
        return False
    try:
        lock_file(descriptor)
    except (BlockingIOError, PermissionError):
        return True
    except OSError:  # a network file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def is_still_there(descriptor: int, path: Path) -> bool:
    """Whether the open file is still the one at `path`: another program may have removed it while we took its lock."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except OSError:
        return False
