"""State of one file that is, or may become, a frame."""

from __future__ import annotations

import errno
import os
import re
import stat
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from gcs_mosaic.frames.appearance import Pause
from gcs_mosaic.frames.exif import captured_s
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.picture_hash import picture_hash
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import DamagedFile, Frame, content_hash

# A file that cannot be read for one of these reasons is as whole as before: the disk, the mount or the machine is not.
PASSING = {
    getattr(errno, name)
    for name in (
        *("EIO", "EMFILE", "ENFILE", "ENOMEM", "EAGAIN", "EINTR", "EBUSY", "ESTALE", "ETIMEDOUT", "ENODEV", "ENXIO"),
        *("ENOTCONN", "ENETDOWN", "EHOSTDOWN", "EHOSTUNREACH", "ECONNRESET", "EREMOTEIO", "ENOMEDIUM"),
    )
    if hasattr(errno, name)
}
CANNOT_READ = "cannot be read"
UNREAD_AFTER_S = 60.0  # then such a file is told as damaged; it is looked at again all the same
HOPELESS = 20  # times the usual pause between two looks at a file that has been told as damaged, and does not change
_VERSIONED = re.compile(r"(.+)#(\d+)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Unread:
    """Why a file cannot be read now."""

    reason: str


@dataclass(frozen=True, slots=True)
class FileRead:
    """A file's bytes, read now, which begin an image at least; `doubt` as in `structure.Whole`."""

    data: bytes
    doubt: str = ""


Prove: TypeAlias = Callable[[bytes, str], str | None]
"""(file, its hash) -> why its picture is not whole; None if it is, or if that cannot be told now."""


@dataclass(slots=True)
class Candidate:
    """A file's state between two scans. `content` is the hash of the last accepted content."""

    settings: FolderSettings
    content: str | None = None
    appeared: Pause | None = None  # between which two scans the newest change happened
    doubt: str = ""  # of the last accepted content, as in `structure.Whole`
    _signature: tuple[int, ...] | None = None
    _settled: bool = False  # nothing to do until the signature changes
    _broken_since: float | None = None
    _reported: bool = False
    _check_at: float = 0.0
    _unchanged_since: float = 0.0
    _refused: tuple[str, str] = ("", "")  # hash of a content that does not decode whole, and why

    @property
    def worth_keeping(self) -> bool:
        """Whether the state must be kept if the file vanishes and comes back."""
        return self._settled or self.content is not None

    def leave(self, look: Look) -> None:
        """Ignore the file in its current state."""
        self._signature, self._settled = look.signature, True

    def is_changed(self, look: Look) -> bool:
        """Whether the file differs from its last scanned state; true for new ones."""
        return look.signature != self._signature

    def is_ready(self, look: Look, now: float) -> bool:
        """Whether to read the file now: unchanged since the last scan, and not known to be done."""
        if look.signature != self._signature:
            self._signature, self._settled, self._broken_since, self._check_at = look.signature, False, None, now
            self._unchanged_since = now
            return False
        return not self._settled and now >= self._check_at

    def take(self, look: Look, now: float, version: int, prove: Prove) -> Frame | DamagedFile | Unread | None:
        """The file as a frame, as damaged (once), as unread (each time), or None: not yet, gone, or content that was accepted
        before. A file of which more may come is waited for while it may, then `prove` decides."""
        name, found = versioned(look.name, version), read_whole(look, self.settings)
        if found is None:
            self._signature = None
            return None
        if isinstance(found, Unread):
            return self._broken(name, found.reason, now, UNREAD_AFTER_S) or found
        if isinstance(found, NotWhole):
            return self._broken(name, found.reason, now, self.settings.damaged_after_s)
        digest = content_hash(found.data)
        if found.doubt and self._waits(now):
            return None
        if found.doubt and (reason := self._refusal(found.data, digest, prove)):
            return self._broken(name, reason, now, 0.0)
        self._settled, self._reported, self.doubt = True, False, found.doubt
        taken_before, self.content = self.content, digest
        if digest == taken_before:
            return None
        frame = frame_of(look, name, found.data, digest)
        return frame if version == 1 else replace(frame, earlier=versioned(look.name, version - 1))

    def _waits(self, now: float) -> bool:
        """Whether more of the file may come; then it is looked at again, for some systems show changes late."""
        end = self._unchanged_since + self.settings.damaged_after_s
        self._check_at = min(now + (now - self._unchanged_since) / 2, end)
        return now < end

    def _refusal(self, data: bytes, digest: str, prove: Prove) -> str | None:
        if digest != self._refused[0]:
            self._refused = digest, prove(data, digest) or ""
        return self._refused[1] or None

    def _broken(self, name: str, reason: str, now: float, patience_s: float) -> DamagedFile | None:
        since = self._broken_since = now if self._broken_since is None else self._broken_since
        is_hopeless = self._reported and not reason.startswith(CANNOT_READ)
        longest_s = self.settings.recheck_longest_s * (HOPELESS if is_hopeless else 1)
        self._check_at = now + min((now - since) / 2, longest_s)
        if self._reported or now - since < patience_s:
            return None
        self._reported = True
        return DamagedFile(name=name, reason=reason)


def read_whole(look: Look, settings: FolderSettings) -> FileRead | NotWhole | Unread | None:
    """The bytes of an image; or why it is not one, or cannot be read now; None if the file is gone or has changed since the
    scan."""
    if look.size > settings.max_file_bytes:
        return NotWhole(f"{look.size} bytes, more than the limit of {settings.max_file_bytes}")
    try:
        data = bytes_of(look.path)
        if len(data) != look.size:
            return None
        whole = is_whole(data, settings.max_pixels)
        return whole if isinstance(whole, NotWhole) else FileRead(data, whole.doubt)
    except FileNotFoundError:
        return None
    except MemoryError:
        return Unread(f"{CANNOT_READ} (not enough memory)")
    except OSError as error:
        reason = f"{CANNOT_READ} ({error.strerror})"
        return Unread(reason) if error.errno in PASSING else NotWhole(reason)


def bytes_of(path: Path) -> bytes:
    """A regular file's content. What has become a pipe or a device since the scan would block for ever: raises OSError."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file")
        return file.read()


def versioned(name: str, version: int) -> str:
    """The frame's name: the file's, with a number from the second version on."""
    return name if version == 1 else f"{name}#{version}"


def file_and_version(name: str) -> tuple[str, int]:
    """Inverse of `versioned`."""
    again = _VERSIONED.fullmatch(name)
    return (again[1], int(again[2])) if again else (name, 1)


def frame_of(look: Look, name: str, data: bytes, digest: str) -> Frame:
    """The frame for `data`, just read."""
    return Frame(
        name=name,
        path=Path(look.path),
        content_hash=digest,
        size=len(data),
        received=time.monotonic(),
        modified=look.modified_ns / 1e9,
        captured=captured_s(data),
        data=data,
        picture=picture_hash(data),
    )
