"""Checkpoints of a flight's state between two frames, so that it can be resumed without repeating work.

Two files: `checkpoint` is rewritten each time and refers to `checkpoint.values`, to which each large value (the features
of a frame, the matches of a pair) is appended once, because such values are immutable. A checkpoint is never ahead of the
ledger, which is synced first. Frames recorded after the checkpoint are in the ledger and are processed again.

The files are pickles, which could name arbitrary code; a restricted unpickler accepts only numbers, containers and this
program's own records, and nothing of them is made before it is known what it costs (`pickle_bounds`).
"""

from __future__ import annotations

import hashlib
import io
import logging
import math
import os
import pickle
import struct
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Literal, cast

import numpy as np

from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import sync_folder, telling_disk_full, write_beside
from gcs_mosaic.store.pickle_bounds import Budget, refuse_unbounded
from gcs_mosaic.store.stages import stage

logger = logging.getLogger(__name__)

NAME, VALUES_NAME = "checkpoint", "checkpoint.values"
FORMAT = 2
MAGIC = b"gcs-mosaic checkpoint\n"
# Format, digest of the program, digest of the payload, name of the values file, its length in bytes.
HEAD = struct.Struct("<I16s16s16sq")
MOST_BYTES = 1 << 30  # of the file that is rewritten each time
LONGEST_REASON = 200  # characters
LARGE = 1024  # bytes; smaller values are stored inline
SHARE = 0.05  # maximum share of time spent on checkpoints
# Allowed in a pickle besides this program's own records.
KNOWN = {
    ("builtins", "set"),
    ("builtins", "frozenset"),
    ("builtins", "complex"),
    ("collections", "OrderedDict"),
    ("collections", "Counter"),
    ("collections", "deque"),
    ("pathlib", "PosixPath"),
    ("pathlib", "WindowsPath"),
    ("pathlib", "PurePosixPath"),
}
OURS = "gcs_mosaic."
PLAIN = "biufc"  # kinds of numbers that arrays may hold; an array of any other could hold pointers


@dataclass(frozen=True, slots=True)
class Unusable:
    """Why a checkpoint cannot be used to resume a flight, phrased as the end of a sentence."""

    reason: str
    stitch_again: bool = False  # the flight can be resumed all the same: from its originals
    of_another_version: bool = False  # nothing is wrong with it


class Checkpoints:
    """Reads and writes the checkpoint of one output folder; `close` waits for the last write. For use by one thread.

    `large`: types whose values are written once and referenced; `received` makes of each that is read what is kept of it.
    `read_only`: for `load` alone, also where nothing can be written.
    """

    def __init__(
        self,
        out: Path,
        large: tuple[type, ...] = (),
        received: Callable[[object], object] = lambda value: value,
        *,
        read_only: bool = False,
    ) -> None:
        self._path, self._values = out / NAME, _Values(out / VALUES_NAME, large, received, read_only=read_only)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="checkpoint")
        self._writing: Future[None] | None = None
        self._due = -math.inf  # monotonic seconds
        self.problem: str | None = None  # why the last write failed

    def load(self) -> Any:
        """Return the last checkpoint's content, or `Unusable`. Call before any write, if at all."""
        try:
            return self._loaded(_read(self._path))
        except FileNotFoundError:
            return Unusable("it has no checkpoint")
        except Exception as error:  # a damaged file may raise anything in the unpickler
            logger.warning("the checkpoint cannot be read", exc_info=True)
            return Unusable(f"its checkpoint cannot be read ({_short(error)})", stitch_again=True)

    def write(self, state: Callable[[], object], ledger_durable: Callable[[], None], *, at_once: bool = False) -> None:
        """Write the result of `state` if due or `at_once`. Failures are logged and retried with the next checkpoint.

        `ledger_durable()` is called, from another thread, before the checkpoint becomes valid: it must sync everything the
        ledger contains.
        """
        if not at_once and (time.monotonic() < self._due or (self._writing and not self._writing.done())):
            return
        self._wait()
        start = time.monotonic()
        with stage("checkpoint", ""):
            made = self._made(state)
        if made is not None:
            self._writing = self._pool.submit(self._write, *made, ledger_durable)
        now = time.monotonic()
        self._due = now + (now - start) / SHARE
        if at_once:
            self._wait()

    def _made(self, state: Callable[[], object]) -> tuple[bytes, bytes] | None:
        """The checkpoint and the new values; None if pickling fails, which must not end a flight."""
        try:
            self._values.begin()
            return self._pickled(state()), self._values.end()
        except Exception as error:
            self._failed(error)
            return None

    def close(self) -> None:
        """Wait for a write in progress."""
        self._wait()
        self._pool.shutdown()
        self._values.close()

    def _wait(self) -> None:
        if self._writing is None:
            return
        error = self._writing.exception()
        self._writing = None
        if error is None:
            self.problem = None
            return
        self._failed(error)

    def _failed(self, error: BaseException) -> None:
        self._values.take_back()
        if self.problem is None:
            logger.warning("the checkpoint could not be written", exc_info=error)
        self.problem = f"the checkpoint could not be written ({error})"

    def _pickled(self, state: object) -> bytes:
        target = io.BytesIO()
        _Pickler(target, self._values.refer, self._values.large).dump(state)
        return target.getvalue()

    def _write(self, data: bytes, new: bytes, ledger_durable: Callable[[], None]) -> None:
        end = self._values.append(new)
        ledger_durable()
        head = HEAD.pack(FORMAT, program_digest(), _digest(data), self._values.name, end)
        write_beside(self._path, MAGIC + head + data, durable=True)

    def _loaded(self, data: bytes) -> Any:
        start = len(MAGIC) + HEAD.size
        if not data.startswith(MAGIC) or len(data) < start:
            return Unusable("its checkpoint is none of ours", stitch_again=True)
        format_, program, digest, name, end = HEAD.unpack(data[len(MAGIC) : start])
        if format_ != FORMAT or program != program_digest():
            reason = "its checkpoint was written by another version of the program"
            return Unusable(reason, stitch_again=True, of_another_version=True)
        if _digest(data[start:]) != digest:
            return Unusable("its checkpoint is damaged", stitch_again=True)
        body = data[start:]
        self._values.open(name, end, Budget(len(body) + max(end, 0)))
        try:
            refuse_unbounded(body, self._values.budget)
            return _Reader(io.BytesIO(body), self._values.value).load()
        finally:
            self._values.loaded()


class _Values:
    """The file of large values: a 16-byte name, then each value prefixed with its length."""

    LENGTH = struct.Struct("<q")

    def __init__(
        self, path: Path, large: tuple[type, ...], received: Callable[[object], object], *, read_only: bool = False
    ) -> None:
        self.large = large
        self._received = received
        self._read_only = read_only
        self.name = b""  # of this file: a checkpoint refers to a file by its name
        self._path = path
        self._file: BinaryIO | None = None
        self._end = 0  # end of all values, pending appends included
        self._sure = 0  # end of the values known to be on disk
        # Offsets by id(); the value is referenced so that its id stays valid.
        self._known: dict[int, tuple[object, int]] = {}
        self._seen: dict[int, tuple[object, int]] = {}  # values referenced by the checkpoint being made
        self._new: list[bytes] = []
        self._read: dict[int, object] = {}
        self.budget = Budget(0)  # of what is read
        self._unread = 0  # bytes: no byte belongs to two values

    def begin(self) -> None:
        """Start a checkpoint."""
        self._seen, self._new = {}, []

    def refer(self, value: object) -> int:
        """Return the value's offset, assigning one past the end if it is new."""
        known = self._seen.get(id(value)) or self._known.get(id(value))
        if known is None:
            data = _pickled(value)
            known = value, self._end
            self._new += [self.LENGTH.pack(len(data)), data]
            self._end += self.LENGTH.size + len(data)
        self._seen[id(value)] = known
        return known[1]

    def end(self) -> bytes:
        """Finish the checkpoint; returns the new values' bytes. Values it does not reference are released."""
        self._known, self._seen = self._seen, {}
        return b"".join(self._new)

    def append(self, new: bytes) -> int:
        """Write and sync new values; returns the end of the file."""
        with telling_disk_full(self._path):
            if self._file is None:
                self._file = self._begun()
            start = len(self.name) + self._sure
            self._file.truncate(start)  # discard an earlier failed attempt
            self._file.seek(start)
            _write_whole(self._file, new)
            os.fsync(self._file.fileno())
            self._sure += len(new)
            return len(self.name) + self._sure

    def take_back(self) -> None:
        """The last append failed: its values may or may not be on disk."""
        self._end = self._sure
        self._known = {key: known for key, known in self._known.items() if known[1] < self._sure}

    def open(self, name: bytes, end: int, budget: Budget) -> None:
        """Continue a file of this name from this offset. Raises ValueError and OSError."""
        opened = inside.descriptor(self._path, self._path.parent, os.O_RDONLY if self._read_only else os.O_RDWR)
        file: BinaryIO = os.fdopen(opened, "rb" if self._read_only else "r+b", buffering=0)
        if end < len(name) or file.read(len(name)) != name or file.seek(0, os.SEEK_END) < end:
            file.close()
            raise ValueError(f"{self._path} is not what the checkpoint refers to")
        self._file, self.name = file, name
        self._end = self._sure = self._unread = end - len(name)
        self.budget = budget

    def value(self, place: int) -> object:
        """The value at an offset."""
        if place not in self._read:
            data = self._data(place)
            refuse_unbounded(data, self.budget)
            read = _Reader(io.BytesIO(data), _no_values).load()
            value = self._read[place] = self._received(read)
            self._known[id(value)] = value, place
        return self._read[place]

    def _data(self, place: int) -> bytes:
        assert self._file is not None, "opened before it is read"
        if not 0 <= place <= self._sure - self.LENGTH.size:
            raise ValueError("it refers to what is not there")
        self._file.seek(len(self.name) + place)
        (length,) = self.LENGTH.unpack(self._file.read(self.LENGTH.size))
        self._unread -= self.LENGTH.size + length
        if not 0 <= length <= self._sure - place or self._unread < 0:
            raise ValueError("its values overlap, or are not there")
        return self._file.read(length)

    def loaded(self) -> None:
        """Reading is complete."""
        self._read = {}

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _begun(self) -> BinaryIO:
        self.name = os.urandom(16)
        how = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        file: BinaryIO = os.fdopen(inside.descriptor(self._path, self._path.parent, how), "wb", buffering=0)
        _write_whole(file, self.name)
        sync_folder(self._path.parent)
        return file


class _Pickler(pickle.Pickler):
    def __init__(self, target: BinaryIO, refer: Callable[[object], int], large: tuple[type, ...]) -> None:
        super().__init__(target, protocol=5)

        def apart(value: object) -> tuple[Any, ...]:
            return _reference, (refer(value),)

        def array_apart(array: np.ndarray[Any, Any]) -> Any:
            return apart(array) if array.nbytes >= LARGE else _plain_array(array)

        self.dispatch_table = {**PLAINLY, **dict.fromkeys(large, apart), np.ndarray: array_apart}


class _Reader(pickle.Unpickler):
    def __init__(self, source: BinaryIO, value: Callable[[int], object]) -> None:
        super().__init__(source)
        self._value = value

    def find_class(self, module: str, name: str) -> Any:
        if module == __name__ and name in BUILT:
            return BUILT[name] or self._value
        if (module, name) in KNOWN:
            return super().find_class(module, name)
        if module.startswith(OURS):
            found = super().find_class(module, name)
            record = isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum | tuple))
            if record and (found.__module__, found.__qualname__) == (module, name):  # not one imported by our module
                return found
        raise pickle.UnpicklingError(f"{module}.{name} does not belong into a checkpoint")


def _read(path: Path) -> bytes:
    """Raises ValueError for more than any checkpoint has; of what is no checkpoint it reads the beginning alone."""
    with inside.reading(path, path.parent) as file:
        begins = file.read(len(MAGIC) + HEAD.size)
        size = os.fstat(file.fileno()).st_size
        if size > MOST_BYTES:
            raise ValueError(f"it has {size >> 20} MB, and {MOST_BYTES >> 20} MB are read at most")
        return begins + file.read(MOST_BYTES) if begins.startswith(MAGIC) else begins


def _short(error: Exception) -> str:
    told = f"{type(error).__name__}: {error}"
    return told if len(told) <= LONGEST_REASON else f"{told[:LONGEST_REASON]}..."


def _write_whole(file: BinaryIO, data: bytes) -> None:
    """A nearly full disk accepts a partial write and reports ENOSPC only for the remainder."""
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


def _reference(place: int) -> object:
    """Placeholder for a value in the other file; the unpickler substitutes its own."""
    raise TypeError(f"value {place} is read by a checkpoint's reader only")


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


def _array(
    kind: str, shape: tuple[int, ...], order: Literal["C", "F"], data: bytes | bytearray
) -> np.ndarray[Any, Any]:
    """An array of plain numbers. Raises ValueError for any other kind."""
    dtype = np.dtype(kind)
    if dtype.kind not in PLAIN:
        raise ValueError(f"an array of {kind} does not belong into a checkpoint")
    return np.frombuffer(data, dtype).reshape(shape, order=order)


def _number(kind: str, data: bytes) -> np.generic:
    return cast(np.generic, _array(kind, (), "C", data)[()])


def _plain_array(array: np.ndarray[Any, Any]) -> Any:
    """How an array is written: layout included, because sums depend on it."""
    order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    flat = np.ascontiguousarray(array.T if order == "F" else array)
    return _array, (array.dtype.str, array.shape, order, pickle.PickleBuffer(flat.data))


def _plain_number(number: np.generic) -> Any:
    return _number, (number.dtype.str, number.tobytes())


# How values are written that pickle would write by functions that are not allowed in a checkpoint.
PLAINLY: dict[type, Callable[[Any], Any]] = {
    np.ndarray: _plain_array,
    **dict.fromkeys(np.sctypeDict.values(), _plain_number),
    MappingProxyType: lambda mapping: (_read_only, (dict(mapping),)),
}
# The functions of this module that are; None stands for the reader's own.
BUILT: dict[str, Callable[..., Any] | None] = {
    _reference.__name__: None,
    _read_only.__name__: _read_only,
    _array.__name__: _array,
    _number.__name__: _number,
}


def _pickled(value: object) -> bytes:
    target = io.BytesIO()
    pickler = pickle.Pickler(target, protocol=5)
    pickler.dispatch_table = PLAINLY
    pickler.dump(value)
    return target.getvalue()


def encoded(value: object) -> bytes:
    """A value of numbers, containers and this program's own records, as bytes for `decoded`."""
    return _pickled(value)


def decoded(data: bytes) -> Any:
    """The value of `encoded`. Whatever else the bytes are, no code is run by them, and they cost little; damaged ones may raise
    anything."""
    refuse_unbounded(data)
    return _Reader(io.BytesIO(data), _no_values).load()


def _no_values(place: int) -> object:
    raise pickle.UnpicklingError("a value refers to no other value")


@cache
def program_digest() -> bytes:
    """Of this program's source: another version may read the same names differently."""
    package = Path(__file__).parents[1]
    sources = sorted(package.rglob("*.py"))
    return _digest(b"\0".join(_digest(path.read_bytes()) for path in sources))


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=16).digest()
