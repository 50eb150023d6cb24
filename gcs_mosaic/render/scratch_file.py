"""A nameless file for what does not fit into memory; it vanishes by itself, however the program ends."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

ROOM = 4096  # bytes; slots are multiples of it, so that they can be reused


class Slot:
    """A place in a scratch file. Freed when nothing refers to it any more."""

    __slots__ = ("_holes", "offset", "size")

    def __init__(self, offset: int, size: int, holes: dict[int, list[int]]) -> None:
        self.offset, self.size, self._holes = offset, size, holes

    def __del__(self) -> None:
        if hasattr(self, "_holes"):  # false if the constructor was interrupted
            self._holes.setdefault(self.size, []).append(self.offset)


class ScratchFile:
    """Uncompressed: reading and writing a tile takes 0.1 ms; PNG at its fastest takes 3 ms to write for a quarter of the bytes.

    `folder` None: the system's folder for temporary files. Reads may come from any thread, writes from one at a time.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 -- lives as long as this object
        self._position = threading.Lock()  # the file's, where there is no pread (Windows)
        self._holes: dict[int, list[int]] = {}  # offsets of free slots, by size
        self.end = 0

    def write(self, *parts: bytes | memoryview) -> Slot:
        """These bytes, one part after another. Raises OSError, and then nothing has changed."""
        length = sum(len(part) for part in parts)
        size = -(-length // ROOM) * ROOM
        holes = self._holes.get(size)
        slot = Slot(holes.pop() if holes else self.end, size, self._holes)
        self.end = max(self.end, slot.offset + slot.size)
        written = self._write_at(slot.offset, [*parts, bytes(size - length)])
        if written != size:
            raise OSError(f"only {written} of {size} bytes could be written")
        return slot

    def read(self, slot: Slot) -> bytes:
        """What was written, and zeros up to the slot's end. Raises OSError."""
        data = self._read_at(slot.offset, slot.size)
        if len(data) != slot.size:
            raise OSError(f"only {len(data)} of {slot.size} bytes could be read")
        return data

    def close(self) -> None:
        self._file.close()

    def _write_at(self, offset: int, parts: Sequence[bytes | memoryview]) -> int:
        """How many bytes were written."""
        if hasattr(os, "pwritev"):
            return os.pwritev(self._file.fileno(), parts, offset)
        with self._position:
            self._file.seek(offset)
            return self._file.write(b"".join(parts)) or 0

    def _read_at(self, offset: int, size: int) -> bytes:
        if hasattr(os, "pread"):
            return os.pread(self._file.fileno(), size, offset)
        with self._position:
            self._file.seek(offset)
            return self._file.read(size)
