"""Whether the output folder is still this flight's; takes it again, and writes its ledger anew, once it can be had.

A folder may be deleted, moved, replaced by another, or be on a disk whose mount is lost while a flight is written to it. What
is decided here:

* deleted, replaced by an empty folder, or back with an older state of this flight: written anew, from memory;
* gone otherwise (moved, its mount lost): waited for, because it may come back with all that it holds;
* replaced by what is not this flight's: waited for, and never touched.
"""

from __future__ import annotations

import logging
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.store.disk import CannotWrite, identity_of
from gcs_mosaic.store.folder import LEDGER_NAME, OUR_NAMES
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.ledger_file import flight_at
from gcs_mosaic.store.lock import FolderLock

logger = logging.getLogger(__name__)

CLOCK_S = 2.0  # by which a file's time may differ from the clock
PUT_BACK = "put it back, or make an empty folder of that name; the flight waits, and goes on by itself"


@dataclass(frozen=True, slots=True)
class Retaken:
    """What had happened to a folder that was taken again, in words; `everything`: what was written to it may be gone."""

    what: str
    everything: bool


class FolderGuard:
    """Guards one output folder, which is locked and has an open ledger. For use by the thread that owns the ledger."""

    def __init__(self, out: Path, lock: FolderLock, ledger: Ledger) -> None:
        self._out, self._lock, self._ledger = out, lock, ledger
        self._path = out / LEDGER_NAME
        self._note()

    def is_ours(self) -> bool:
        """Whether the folder at the path is this flight's; cheap, and callable from any thread."""
        return self._lock.holds(self._out)

    def ensure(self) -> Retaken | None:
        """None if all is in place; else what was taken again. Raises CannotWrite, OSError and DiskFull while it cannot be
        had."""
        identity = identity_of(self._path)
        if self.is_ours() and identity == self._file and not self._ledger.damaged:
            self._seen_utc = time.time()
            return None
        taken = Retaken(self._lost(identity), everything=not self.is_ours() or identity != self._file)
        logger.warning("%s: %s", self._out, taken.what)
        self._take()
        self._ledger.write_anew()
        self._note()
        return taken

    def _note(self) -> None:
        """What tells this folder from another at the same path."""
        self._file, self._folder = identity_of(self._path), identity_of(self._out)
        self._is_mount, self._disks = os.path.ismount(self._out), disks_above(self._out)
        self._seen_utc = time.time()

    def _lost(self, identity: tuple[int, int] | None) -> str:
        if not self.is_ours():
            return "the folder was deleted" if self._lock.is_deleted else "the folder was away, or replaced"
        if identity is None:
            return f"{LEDGER_NAME} was deleted"
        return f"{LEDGER_NAME} was replaced" if identity != self._file else f"{LEDGER_NAME} may have lost something"

    def _take(self) -> None:
        if not self._out.exists() and (self._lock.is_deleted or self._is_on_new_disk()):
            self._out.mkdir(parents=True, exist_ok=True)
        if obstacle := self._obstacle():
            raise CannotWrite(f"{self._out} cannot be written: {obstacle}")
        if not self._lock.holds(self._out) and not self._lock.move_to(self._out):
            raise CannotWrite(f"{self._out} is being written by another gcs-mosaic: end that one, then it goes on")

    def _obstacle(self) -> str:
        """Why the folder cannot be taken now, and what to do; empty if it can."""
        if not self._out.is_dir():
            return f"the folder is gone; {PUT_BACK}"
        if self._is_mount and not os.path.ismount(self._out):
            return f"its mount is gone; {PUT_BACK}"
        if identity_of(self._path) not in (None, self._file) and not self._is_older_state():
            return f"the {LEDGER_NAME} there is not this flight's, and left as it is: move it away, then it goes on"
        known = self.is_ours() or identity_of(self._out) == self._folder  # the second: all that is in it was deleted
        if known or identity_of(self._path) is not None:
            return ""
        strange = next((name for name in OUR_NAMES if self._is_strange(self._out / name)), "")
        return (
            f"it has a {strange} of its own, which is left as it is: move it away, then it goes on" if strange else ""
        )

    def _is_strange(self, path: Path) -> bool:
        """Whether something is there that was not written by this flight into a new folder before that was noticed."""
        with suppress(OSError):
            return path.lstat().st_mtime < self._seen_utc - CLOCK_S
        return False

    def _is_older_state(self) -> bool:
        """Whether the ledger at the path is an older state of this flight, not another one's."""
        ours = self._ledger.flight()
        return ours is not None and flight_at(self._path) == (ours.name, ours.started_utc)

    def _is_on_new_disk(self) -> bool:
        """Whether another disk is mounted where that of the folder was."""
        above = disks_above(self._out)
        return bool(above) and above[0] not in self._disks


def disks_above(out: Path) -> list[int]:
    """The devices of the folder, if it is there, and of the folders above it, from below."""
    disks = []
    for folder in (out.absolute(), *out.absolute().parents):
        with suppress(OSError):
            disks.append(folder.stat().st_dev)
    return disks
