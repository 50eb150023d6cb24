"""Pictures of tiles with what is needed to go on painting them, and a store that keeps most of them off the memory."""

from __future__ import annotations

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


class _Record(NamedTuple):
    offset: int
    size: int
    side: int
    bands: int
    kind: np.dtype[Any]  # of the bands
    measured: int  # numbers at each lattice point


class LayerStore:
    """Layers by key: the most recently used in memory, the others losslessly in an unnamed file that vanishes by itself.

    Uncompressed: reading and writing a layer takes 0.1 ms so; PNG at its fastest takes 3 ms to write for a quarter of the
    bytes. `folder` None means the system's own place for such files. While the disk is full layers stay in memory and
    `problem` says why; nothing is lost.
    """

    def __init__(self, memory_bytes: int, folder: Path | None = None) -> None:
        self._memory_bytes = memory_bytes
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 -- lives as long as the store
        self._cached: OrderedDict[LayerKey, Layer] = OrderedDict()
        self._spilled: dict[LayerKey, _Record] = {}
        self._holes: dict[int, list[int]] = {}  # offsets of free places, by size
        self._end = 0
        self._used = 0
        self.problem: str | None = None

    def get(self, key: LayerKey) -> Layer | None:
        layer = self._cached.get(key)
        if layer is not None:
            self._cached.move_to_end(key)
            return layer
        record = self._spilled.get(key)
        if record is None:
            return None
        layer = _unpacked(os.pread(self._file.fileno(), record.size, record.offset), record)
        self._keep(key, layer)
        return layer

    def put(self, key: LayerKey, layer: Layer | None) -> None:
        """Keep a layer under a key, in place of what was there; None drops it."""
        self._drop(key)
        if layer is not None:
            self._keep(key, layer)

    @property
    def bytes_on_disk(self) -> int:
        return self._end

    def close(self) -> None:
        """Give back all memory and disk."""
        self._cached.clear()
        self._spilled.clear()
        self._file.close()

    def _keep(self, key: LayerKey, layer: Layer) -> None:
        self._cached[key] = layer
        self._used += layer.nbytes
        try:
            while self._used > self._memory_bytes and len(self._cached) > 1:
                self._evict()
            self.problem = None
        except OSError as error:
            self.problem = f"the scratch file of the painting cannot grow: {error}"

    def _evict(self) -> None:
        oldest, layer = next(iter(self._cached.items()))
        if oldest not in self._spilled:
            self._spilled[oldest] = self._write(layer)
        del self._cached[oldest]
        self._used -= layer.nbytes

    def _drop(self, key: LayerKey) -> None:
        old = self._cached.pop(key, None)
        self._used -= 0 if old is None else old.nbytes
        record = self._spilled.pop(key, None)
        if record is not None:
            self._holes.setdefault(record.size, []).append(record.offset)

    def _write(self, layer: Layer) -> _Record:
        data = _packed(layer)
        holes = self._holes.get(len(data))
        offset = holes[-1] if holes else self._end
        written = os.pwrite(self._file.fileno(), data, offset)
        if written != len(data):
            raise OSError(f"only {written} of {len(data)} bytes of a tile could be written")
        if holes:
            holes.pop()
        self._end = max(self._end, offset + len(data))
        bands = np.empty((1, 1, 0), np.uint8) if layer.bands is None else layer.bands
        measured = 0 if layer.measured is None else layer.measured.shape[2]
        return _Record(offset, len(data), layer.side, bands.shape[2], bands.dtype, measured)


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
