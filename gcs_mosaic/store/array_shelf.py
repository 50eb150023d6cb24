"""Arrays of which only those used lately are in memory; the others lie in a scratch file. Implements `stitch.features.shelf`."""

from __future__ import annotations

import itertools
import logging
import threading
import weakref
from collections import OrderedDict, deque
from pathlib import Path

import numpy as np

from gcs_mosaic.render.scratch_file import ScratchFile, Slot
from gcs_mosaic.stitch.arrays import AnyArray

logger = logging.getLogger(__name__)


class ArrayShelf:
    """Keeps about `memory_bytes` of arrays in memory, and none that nothing refers to any more. Thread-safe.

    `folder`: of the scratch file. While it cannot be written, arrays stay in memory; one that cannot be read is zeros, until it
    can be read again. `problem` says so.
    """

    def __init__(self, memory_bytes: int, folder: Path | None = None) -> None:
        self.problem: str | None = None
        self._memory_bytes = memory_bytes
        self._file = ScratchFile(folder)
        self._lock = threading.Lock()
        # By number; the one used last is last.
        self._cached: OrderedDict[int, tuple[weakref.ref[ShelvedArray], AnyArray]] = OrderedDict()
        self._used = 0
        self._numbers = itertools.count()
        self._gone: deque[int] = deque()  # of arrays that nothing refers to; told from any thread, at any moment

    def shelve(self, array: AnyArray) -> ShelvedArray:
        """The array, which must not change any more."""
        shelved = ShelvedArray(self, next(self._numbers), array)
        with self._lock:
            self._keep(shelved, array)
        return shelved

    def forget(self, number: int) -> None:
        """Nothing refers to that array any more. Takes no lock, so that a finalizer may call it."""
        self._gone.append(number)

    def close(self) -> None:
        """Release memory and disk space."""
        with self._lock:
            self._cached.clear()
            self._file.close()

    def found(self, shelved: ShelvedArray) -> AnyArray:
        """Raises OSError."""
        with self._lock:
            cached = self._cached.get(shelved.number)
            if cached is not None:
                self._cached.move_to_end(shelved.number)
                return cached[1]
            slot = shelved.slot
        assert slot is not None, "an array is in memory or in the file"
        data = np.frombuffer(self._file.read(slot), shelved.dtype, int(np.prod(shelved.shape)))
        array = data.reshape(shelved.shape)
        with self._lock:
            if shelved.number not in self._cached:
                self._keep(shelved, array)
        return array

    def note_lost(self, error: OSError) -> None:
        if self.problem is None:
            logger.warning("features cannot be read back", exc_info=error)
        self.problem = f"the scratch file of the features cannot be read: {error}"

    def _keep(self, shelved: ShelvedArray, array: AnyArray) -> None:
        self._drop_gone()
        self._cached[shelved.number] = weakref.ref(shelved), array
        self._used += array.nbytes
        try:
            while self._used > self._memory_bytes and len(self._cached) > 1:
                self._evict()
        except OSError as error:
            if self.problem is None:
                logger.warning("the scratch file cannot grow", exc_info=True)
            self.problem = f"the scratch file of the features cannot grow: {error}"

    def _evict(self) -> None:
        number, (reference, array) = next(iter(self._cached.items()))
        oldest = reference()
        if oldest is not None and oldest.slot is None:
            oldest.slot = self._file.write(np.ascontiguousarray(array).data.cast("B"))
            self.problem = None
        self._drop(number)

    def _drop_gone(self) -> None:
        while self._gone:
            self._drop(self._gone.popleft())

    def _drop(self, number: int) -> None:
        cached = self._cached.pop(number, None)
        if cached is not None:
            self._used -= cached[1].nbytes


class ShelvedArray:
    """An array on a shelf."""

    __slots__ = ("__weakref__", "_shelf", "dtype", "number", "shape", "slot")

    def __init__(self, shelf: ArrayShelf, number: int, array: AnyArray) -> None:
        self._shelf, self.number = shelf, number
        self.shape, self.dtype = array.shape, array.dtype
        self.slot: Slot | None = None  # in the scratch file, once it was put there

    def __del__(self) -> None:
        if hasattr(self, "number"):  # false if the constructor was interrupted
            self._shelf.forget(self.number)

    def array(self) -> AnyArray:
        """The array; zeros if it is lost."""
        try:
            return self.exact()
        except OSError as error:
            self._shelf.note_lost(error)
            return np.zeros(self.shape, self.dtype)

    def exact(self) -> AnyArray:
        """The array. Raises OSError if it is lost."""
        return self._shelf.found(self)
