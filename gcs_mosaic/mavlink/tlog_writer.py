"""Records received packets as a telemetry log (.tlog) for MAVProxy, Mission Planner, QGroundControl and `replay`.

The format has no header: each packet is preceded by its arrival time in microseconds since 1970 (big-endian, 64 bits).
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Literal

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.tlog import TIME
from gcs_mosaic.messages import Notice

FLUSH_S = 0.5  # the most that a kill loses; flushing every packet would cost a system call each
_RETRY_S = 2.0  # between write attempts on a full disk
_MOST_UNWRITTEN = 1 << 20  # bytes; more than a second of the fastest link


class Recording:
    """One file for all links. Packets that cannot be written are dropped, counted and reported; a flight never ends by it.

    `record` is thread-safe. Nothing is written before `open`.
    """

    def __init__(self) -> None:
        self._file: FileIO | None = None
        self._path = Path()
        self._lock = threading.Lock()
        self._utc_of_zero = time.time() - time.monotonic()  # fixed, so that setting the system clock does no harm
        self._unwritten = bytearray()
        self._packets = 0  # in `_unwritten`
        self._last_us = 0
        self._next_write = 0.0
        self._lost: int | None = None  # packets dropped since writing began to fail
        self._sure: int | None = None  # end of the last whole packet, if a partial one may follow

    def open(self, path: Path, *, ours: bool) -> Notice:
        """Write to `path` from now on; append to an existing file if it is `ours`, else raise UsageError."""
        try:
            self._file = path.open("a+b" if ours else "x+b", buffering=0)
        except OSError as error:
            why = "is there already" if isinstance(error, FileExistsError) else f"cannot be written ({error.strerror})"
            raise UsageError(f"--record {str(path)!r} {why}: give a new file, such as flight-2.tlog.") from error
        self._path = path
        return _notice("info", f"what is heard is recorded to {path}")

    def record(self, arrival: Arrival) -> None:
        """Buffer the message's packet until `flush`."""
        if self._file is None:
            return
        with self._lock:
            # Links on several threads are slightly out of order; a decreasing timestamp would read as corruption.
            self._last_us = max(self._last_us, int((arrival.received + self._utc_of_zero) * 1e6))
            self._unwritten += TIME.pack(self._last_us) + arrival.message.get_msgbuf()
            self._packets += 1

    def flush(self, now: float, *, at_once: bool = False) -> Iterator[Notice]:
        """Write the buffered packets if due at `now` (monotonic seconds); yields notices."""
        with self._lock:
            if self._file is not None and (at_once or now >= self._next_write or self._is_long()):
                yield from self._write(self._file, now)

    def reopen(self) -> None:
        """Go on in the file at the path, after its folder was lost. It begins with what was recorded so far, if that can still be
        read; else it may be older. Raises OSError."""
        with self._lock:
            if self._file is None or _is_at(self._file, self._path):
                return
            recorded = _written(self._file)
            new = self._path.open("w+b" if recorded else "a+b", buffering=0)
            try:
                _write_whole(new, recorded)
            except OSError:
                new.close()
                raise
            self._file.close()
            self._file, self._sure = new, None

    def close(self) -> None:
        """Write the rest. An empty file is removed."""
        if self._file is None:
            return
        list(self.flush(time.monotonic(), at_once=True))
        with self._file as file:
            is_empty = file.tell() == 0
        self._file = None
        if is_empty:
            self._path.unlink(missing_ok=True)

    def _is_long(self) -> bool:
        return len(self._unwritten) > _MOST_UNWRITTEN

    def _write(self, file: FileIO, now: float) -> Iterator[Notice]:
        try:
            self._sure = file.seek(0, 2) if self._sure is None else file.truncate(self._sure)
            _write_whole(file, self._unwritten)
            self._sure = None
        except OSError as error:
            self._next_write = now + _RETRY_S
            if self._lost is None:
                self._lost = 0
                text = f"the recording {self._path} cannot be written ({error.strerror}): the flight goes on without it"
                yield _notice("error", text)
            if self._is_long():
                self._lost += self._packets
                self._forget()
            return
        self._forget()
        self._next_write = now + FLUSH_S
        if self._lost is not None:
            text = f"the recording {self._path} is written again; {self._lost} packets are missing in it"
            self._lost = None
            yield _notice("info", text)

    def _forget(self) -> None:
        self._unwritten.clear()
        self._packets = 0


def _written(file: FileIO) -> bytes:
    """Everything in an open file, which may have no name any more."""
    try:
        file.seek(0)
        return file.read()
    except OSError:  # its disk is gone
        return b""


def _is_at(file: FileIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:  # none is there
        return False


def _notice(level: Literal["info", "error"], text: str) -> Notice:
    return Notice(source="recording", level=level, text=text)


def _write_whole(file: FileIO, data: bytes | bytearray) -> None:
    left = memoryview(bytes(data))
    while left:
        left = left[file.write(left) :]
