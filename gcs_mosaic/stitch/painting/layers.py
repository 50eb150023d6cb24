"""Pictures of tiles with what is needed to go on painting them, and a store that keeps most of them off the memory."""

from __future__ import annotations

import logging
import os
import tempfile
from collections import OrderedDict
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.painting.grid import Tile
from gcs_mosaic.stitch.painting.lattice import LATTICE_STEP, Lattice
from gcs_mosaic.stitch.transaction import Kept, Snapshot

logger = logging.getLogger(__name__)

Image = NDArray[np.uint8]
Measured = NDArray[np.float16]  # half the memory; no map needs more than three digits


@cache
def full_coverage(side: int) -> Image:
    """The one array that stands for "everywhere", so that full layers need no mask of their own."""
    coverage = np.full((side, side), 255, dtype=np.uint8)
    coverage.setflags(write=False)
    return coverage


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A square picture; never changed in place, so it may be handed to other threads.

    `colour` (n, n, 3) BGR, 0 where there is none; `coverage` (n, n), 0 to 255; `weight` (n / 16 + 1, n / 16 + 1) at the
    lattice points, 0 where nothing is sure and 1 in the middle of a frame; `bands` (n, n, bands) uint8 or uint16, the frames'
    own bands mixed as the colour is, only where somebody wants them (an export); `measured` (n / 8 + 1, n / 8 + 1, k)
    what the blend has to remember of what is shown at points twice as close, if anything.
    """

    colour: Image
    coverage: Image
    weight: Lattice
    bands: Bands | None = None
    measured: Measured | None = None

    @property
    def side(self) -> int:
        return len(self.colour)

    @property
    def is_full(self) -> bool:
        return self.coverage is full_coverage(self.side)

    @property
    def nbytes(self) -> int:
        parts = (self.colour, self.weight, None if self.is_full else self.coverage, self.bands, self.measured)
        return sum(0 if part is None else part.nbytes for part in parts)


def make_layer(
    colour: Image,
    coverage: Image | None,
    weight: Lattice,
    bands: Bands | None = None,
    measured: Measured | None = None,
) -> Layer | None:
    """A layer of these parts (`coverage` None: full); None if nothing is covered."""
    side = colour.shape[0]
    if coverage is None or int(coverage.min()) == 255:
        return Layer(colour, full_coverage(side), weight, bands, measured)
    return Layer(colour, coverage, weight, bands, measured) if coverage.any() else None


class LayerKey(NamedTuple):
    island: int
    tile: Tile
    kind: Literal["own", "fresh", "quarter"]  # a tile's own layer; the next one, not yet whole; all of it at half size


class _Place:
    """Room in the scratch file. Given back when nobody knows of it any more, neither the store nor a snapshot of it."""

    __slots__ = ("_holes", "offset", "size")

    def __init__(self, offset: int, size: int, holes: dict[int, list[int]]) -> None:
        self.offset, self.size, self._holes = offset, size, holes

    def __del__(self) -> None:
        self._holes.setdefault(self.size, []).append(self.offset)


class _Record(NamedTuple):
    place: _Place
    side: int
    bands: int
    kind: np.dtype[Any]  # of the bands
    measured: int  # numbers at each lattice point


@dataclass(slots=True, eq=False)
class _Held:
    """A layer, in memory or in the file or both. Which layer never changes, only where it is."""

    layer: Layer | None
    record: _Record | None = None


class LayerStore(Kept):
    """Layers by key: the most recently used in memory, the others losslessly in an unnamed file that vanishes by itself.

    Uncompressed: reading and writing a layer takes 0.1 ms so; PNG at its fastest takes 3 ms to write for a quarter of the
    bytes. `folder` None means the system's own place for such files. While the disk is full layers stay in memory and
    `problem` says why; nothing is lost. What a snapshot knows of stays in memory or in the file as long as the snapshot.
    """

    # Where layers are is nothing that could be undone, nor needs to be: only which there are.
    FIXED = frozenset({"_memory_bytes", "_file", "_cached", "_holes", "_end", "_used", "problem"})

    def __init__(self, memory_bytes: int, folder: Path | None = None) -> None:
        self._memory_bytes = memory_bytes
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 -- lives as long as the store
        self._held: dict[LayerKey, _Held] = {}
        self._cached: OrderedDict[LayerKey, _Held] = OrderedDict()  # those of them that are in memory
        self._holes: dict[int, list[int]] = {}  # offsets of free places, by size
        self._end = 0
        self._used = 0
        self.problem: str | None = None

    def restore(self, before: Snapshot) -> None:
        super().restore(before)
        cached = {key: held for key, held in self._cached.items() if self._held.get(key) is held}
        others = {key: held for key, held in self._held.items() if held.layer is not None and key not in cached}
        self._cached = OrderedDict(others | cached)
        self._used = sum(held.layer.nbytes for held in self._cached.values() if held.layer is not None)

    def get(self, key: LayerKey) -> Layer | None:
        held = self._held.get(key)
        if held is None:
            return None
        if held.layer is not None:
            self._cached[key] = held
            self._cached.move_to_end(key)
            return held.layer
        assert held.record is not None, "a layer is in memory or in the file"
        place = held.record.place
        layer = _unpacked(os.pread(self._file.fileno(), place.size, place.offset), held.record)
        self._keep(key, held, layer)
        return layer

    def put(self, key: LayerKey, layer: Layer | None) -> None:
        """Keep a layer under a key, in place of what was there; None drops it."""
        self._held.pop(key, None)
        old = self._cached.pop(key, None)
        self._used -= 0 if old is None or old.layer is None else old.layer.nbytes
        if layer is not None:
            held = self._held[key] = _Held(layer)
            self._keep(key, held, layer)

    @property
    def bytes_on_disk(self) -> int:
        return self._end

    def close(self) -> None:
        """Give back all memory and disk."""
        self._cached.clear()
        self._held.clear()
        self._file.close()

    def _keep(self, key: LayerKey, held: _Held, layer: Layer) -> None:
        held.layer = layer
        self._cached[key] = held
        self._used += layer.nbytes
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
        assert held.layer is not None, "what is cached is in memory"
        held.record = held.record or self._write(held.layer)
        del self._cached[oldest]
        self._used -= held.layer.nbytes
        held.layer = None

    def _write(self, layer: Layer) -> _Record:
        data = _packed(layer)
        holes = self._holes.get(len(data))
        place = _Place(holes.pop() if holes else self._end, len(data), self._holes)
        self._end = max(self._end, place.offset + place.size)
        written = os.pwrite(self._file.fileno(), data, place.offset)
        if written != len(data):
            raise OSError(f"only {written} of {len(data)} bytes of a tile could be written")
        bands = np.empty((1, 1, 0), np.uint8) if layer.bands is None else layer.bands
        measured = 0 if layer.measured is None else layer.measured.shape[2]
        return _Record(place, layer.side, bands.shape[2], bands.dtype, measured)


def _packed(layer: Layer) -> bytes:
    parts = (layer.colour, layer.weight, layer.bands, layer.measured, None if layer.is_full else layer.coverage)
    return b"".join(part.tobytes() for part in parts if part is not None)


def _unpacked(data: bytes, record: _Record) -> Layer:
    side, points, fine = record.side, record.side // LATTICE_STEP + 1, 2 * record.side // LATTICE_STEP + 1
    ends = np.cumsum(
        [
            3 * side * side,
            4 * points * points,
            side * side * record.bands * record.kind.itemsize,
            2 * fine * fine * record.measured,
        ]
    ).tolist()
    colour, weight, bands, measured, coverage = (data[a:b] for a, b in zip([0, *ends], [*ends, len(data)], strict=True))
    known = np.frombuffer(measured, np.float16).reshape(fine, fine, record.measured) if measured else None
    return Layer(
        np.frombuffer(colour, np.uint8).reshape(side, side, 3),
        np.frombuffer(coverage, np.uint8).reshape(side, side) if coverage else full_coverage(side),
        np.frombuffer(weight, np.float32).reshape(points, points),
        np.frombuffer(bands, record.kind).reshape(side, side, record.bands) if bands else None,
        known,
    )
