"""Tile layers with the state needed to continue painting, and a store that keeps most of them out of memory."""

from __future__ import annotations

import logging
import pickle
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gcs_mosaic.render.scratch_file import ScratchFile, Slot
from gcs_mosaic.stitch.arrays import Bands, Coverage, ImageBGR, Lattice
from gcs_mosaic.stitch.transaction import Kept, Snapshot

logger = logging.getLogger(__name__)

Key = Hashable

ALIGNED = 64  # bytes


@cache
def full_coverage(side: int) -> Coverage:
    """The one array that stands for "everywhere", so that full layers need no mask of their own."""
    coverage = np.full((side, side), 255, dtype=np.uint8)
    coverage.setflags(write=False)
    return coverage


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A square image; immutable, so it may be handed to other threads.

    `colour` (n, n, 3) BGR, 0 where uncovered; `coverage` (n, n), 0 to 255; `weight` (n / 16 + 1, n / 16 + 1) at the lattice
    points, 0 at borders and 1 in the middle of a frame; `bands` (n, n, bands) uint8 or uint16, the frames' own bands mixed like
    the colour, only if kept (for an export).
    """

    colour: ImageBGR
    coverage: Coverage
    weight: Lattice
    bands: Bands | None = None

    @property
    def side(self) -> int:
        return len(self.colour)

    @property
    def is_full(self) -> bool:
        return self.coverage is full_coverage(self.side)

    @property
    def nbytes(self) -> int:
        parts = (self.colour, self.weight, None if self.is_full else self.coverage, self.bands)
        return sum(0 if part is None else part.nbytes for part in parts)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles a full layer such that it is recognised as full again."""
        return make_layer, (self.colour, None if self.is_full else self.coverage, self.weight, self.bands)


def make_layer(
    colour: ImageBGR, coverage: Coverage | None, weight: Lattice, bands: Bands | None = None
) -> Layer | None:
    """A layer of these parts (`coverage` None: full); None if nothing is covered."""
    side = colour.shape[0]
    if coverage is None or int(coverage.min()) == 255:
        return Layer(colour, full_coverage(side), weight, bands)
    return Layer(colour, coverage, weight, bands) if coverage.any() else None


class Sized(Protocol):
    """Values of a store: immutable and picklable."""

    @property
    def nbytes(self) -> int: ...


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a value is in the file: pickled, and its arrays of these lengths behind that, each as it is in memory."""

    slot: Slot
    lengths: tuple[int, ...]


@dataclass(slots=True, eq=False)
class _Held:
    """A value, in memory or in the file or both. The value never changes, only its location."""

    value: Any
    place: _Place | None = None


class Store(Kept):
    """Values by key: the most recently used in memory, the others losslessly in an unnamed file that vanishes by itself.

    `folder` None: the system's folder for temporary files. While the disk is full, values stay in memory and `problem` says
    why; nothing is lost. Values in a snapshot stay in memory or in the file as long as the snapshot.
    """

    # The location of values cannot and need not be restored: only which values there are.
    FIXED = frozenset({"_memory_bytes", "_file", "_cached", "_used", "problem"})

    def __init__(self, memory_bytes: int, folder: Path | None = None) -> None:
        self._memory_bytes = memory_bytes
        self._file = ScratchFile(folder)
        self._held: dict[Key, _Held] = {}
        self._cached: OrderedDict[Key, _Held] = OrderedDict()  # those of them that are in memory
        self._used = 0
        self.problem: str | None = None

    def restore(self, before: Snapshot) -> None:
        super().restore(before)
        cached = {key: held for key, held in self._cached.items() if self._held.get(key) is held}
        others = {key: held for key, held in self._held.items() if held.value is not None and key not in cached}
        self._cached = OrderedDict(others | cached)
        self._used = sum(held.value.nbytes for held in self._cached.values() if held.value is not None)

    def __contains__(self, key: Key) -> bool:
        return key in self._held

    def get(self, key: Key) -> Any:
        held = self._held.get(key)
        if held is None:
            return None
        if held.value is not None:
            self._cached[key] = held
            self._cached.move_to_end(key)
            return held.value
        value = self._read(held)
        self._keep(key, held, value)
        return value

    def put(self, key: Key, value: Sized | None) -> None:
        """Store a value under a key, replacing the old one; None removes it."""
        self._held.pop(key, None)
        old = self._cached.pop(key, None)
        self._used -= 0 if old is None or old.value is None else old.value.nbytes
        if value is not None:
            held = self._held[key] = _Held(value)
            self._keep(key, held, value)

    def take_over(self, key: Key, old: Key) -> None:
        """Move the value at the old key to this one, replacing its value; nothing is written again."""
        self.put(key, None)
        held = self._held.pop(old, None)
        if held is not None:
            self._held[key] = held
            if self._cached.pop(old, None) is not None:
                self._cached[key] = held

    def close(self) -> None:
        """Release all memory and disk space."""
        self._cached.clear()
        self._held.clear()
        self._file.close()

    def _keep(self, key: Key, held: _Held, value: Sized) -> None:
        held.value = value
        self._cached[key] = held
        self._used += value.nbytes
        try:
            while self._used > self._memory_bytes and len(self._cached) > 1:
                self._evict()
            self.problem = None
        except OSError as error:
            if self.problem is None:
                logger.warning("the scratch file cannot grow", exc_info=True)
            self.problem = f"the scratch file of the painting cannot grow: {error}"

    def _evict(self) -> None:
        oldest, held = next(iter(self._cached.items()))
        assert held.value is not None, "what is cached is in memory"
        held.place = held.place or self._write(held.value)
        del self._cached[oldest]
        self._used -= held.value.nbytes
        held.value = None

    def _write(self, value: Sized) -> _Place:
        buffers: list[pickle.PickleBuffer] = []
        pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)  # which copies no array
        parts = [memoryview(pickled), *(buffer.raw() for buffer in buffers)]
        gaps = (bytes(_aligned(len(part)) - len(part)) for part in parts)
        slot = self._file.write(*[piece for both in zip(parts, gaps, strict=True) for piece in both])
        return _Place(slot, tuple(len(part) for part in parts))

    def _read(self, held: _Held) -> Any:
        assert held.place is not None, "a value is in memory or in the file"
        data = memoryview(self._file.read(held.place.slot))
        parts: list[memoryview] = []
        start = 0
        for length in held.place.lengths:
            parts.append(data[start : start + length])
            start += _aligned(length)
        return pickle.loads(parts[0], buffers=parts[1:])


def _aligned(length: int) -> int:
    """A length up to where an array of any type may begin."""
    return -(-length // ALIGNED) * ALIGNED
