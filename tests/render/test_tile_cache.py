import resource
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.render.render_list import TileKey
from gcs_mosaic.render.tile_cache import Layer, Store, full_coverage, make_layer
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.render.warp_grid import LATTICE
from tests.sure import sure


def layer(seed: int, full: bool = True) -> Layer:
    rng = np.random.default_rng(seed)
    coverage = None if full else (rng.random((256, 256)) < 0.5).astype(np.uint8) * 255
    colour = rng.integers(0, 255, (256, 256, 3), dtype=np.uint8)
    weight = rng.random((LATTICE, LATTICE), dtype=np.float32)
    bands = None if seed % 3 == 0 else rng.integers(0, 4000, (256, 256, seed % 3)).astype(np.uint16)
    return sure(make_layer(colour, coverage, weight, bands))


@dataclass(frozen=True)
class _Arrays:
    arrays: tuple[NDArray[Any], ...]
    nbytes: int = 1000


@pytest.fixture
def new_store(tmp_path: Path) -> Iterator[Callable[[int], Store]]:
    with ExitStack() as stack:
        yield lambda memory_bytes: stack.enter_context(closing(Store(memory_bytes, tmp_path)))


def key(i: int) -> tuple[TileKey, str]:
    return (0, Tile(16, i, 0)), "own"


def same(a: Layer, b: Layer) -> bool:
    return all(np.array_equal(getattr(a, part), getattr(b, part)) for part in ("colour", "coverage", "weight", "bands"))


def test_a_layer_that_covers_everything_knows_it() -> None:
    assert layer(1).is_full
    full = sure(make_layer(layer(1).colour, np.full((256, 256), 255, np.uint8), layer(1).weight))
    assert full.coverage is full_coverage(256)
    assert not layer(1, full=False).is_full


def test_a_layer_that_covers_nothing_is_none() -> None:
    assert make_layer(layer(1).colour, np.zeros((256, 256), np.uint8), layer(1).weight) is None


def test_layers_come_back_as_they_were_from_memory_and_disk(new_store: Callable[[int], Store]) -> None:
    store = new_store(600_000)
    for i in range(9):
        store.put(key(i), layer(i, full=i % 2 == 0))
    assert all(same(store.get(key(i)), layer(i, full=i % 2 == 0)) for i in (0, 8, 1, 7, 2, 6, 3, 5, 4))
    assert [store.get(key(i)).is_full for i in range(9)] == [i % 2 == 0 for i in range(9)]
    assert store.get(key(99)) is None


def test_arrays_of_any_kind_come_back_from_the_disk_where_their_type_may_begin(
    new_store: Callable[[int], Store],
) -> None:
    kinds = [
        np.arange(size, dtype=kind) for kind in (np.uint8, np.int16, np.float32, np.float64) for size in (1, 7, 999)
    ]
    views = [np.arange(60).reshape(6, 10)[::2, 1:], np.asfortranarray(np.eye(5)), np.zeros((0, 3))]
    store = new_store(1)
    for i, array in enumerate([*kinds, *views]):
        store.put(key(i), _Arrays((array, array[:1])))
    for i, array in enumerate([*kinds, *views]):
        for one, other in zip(store.get(key(i)).arrays, (array, array[:1]), strict=True):
            np.testing.assert_array_equal(one, other, strict=True)
            assert one.flags.aligned


def test_a_layer_that_gets_another_key_is_not_written_again(new_store: Callable[[int], Store]) -> None:
    store = new_store(600_000)
    for i in range(9):
        store.put(key(i), layer(i))
    store.put("other", layer(9))
    written = store._file.end
    before = store.snapshot()
    store.take_over("other", key(0))
    store.take_over("nothing", "none")
    assert store.get(key(0)) is None
    assert "nothing" not in store
    assert same(store.get("other"), layer(0))
    for i in range(1, 9):
        assert same(store.get(key(i)), layer(i))
    assert store._file.end <= written + 2 * 270_000  # those that had never been written
    store.restore(before)
    assert same(store.get(key(0)), layer(0))
    assert same(store.get("other"), layer(9))


def test_the_newest_layer_under_a_key_counts(new_store: Callable[[int], Store]) -> None:
    store = new_store(300_000)
    for i in range(8):
        store.put(key(i % 2), layer(i))
    assert same(store.get(key(0)), layer(6))
    assert same(store.get(key(1)), layer(7))
    store.put(key(1), None)
    assert store.get(key(1)) is None


def test_the_scratch_file_does_not_grow_while_layers_are_replaced(new_store: Callable[[int], Store]) -> None:
    store = new_store(300_000)
    for i in range(40):
        store.put(key(i % 4), layer(3 * i))
    assert store._file.end <= 4 * 1.05 * layer(0).nbytes


def test_when_the_disk_is_full_layers_stay_in_memory_and_it_is_said(new_store: Callable[[int], Store]) -> None:
    store = new_store(300_000)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, limits[1]))
    try:
        for i in range(5):
            store.put(key(i), layer(i))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "scratch file" in sure(store.problem)
    assert all(same(store.get(key(i)), layer(i)) for i in range(5))
    store.put(key(9), layer(9))
    assert store.problem is None


def test_what_is_put_back_is_there_though_its_place_in_the_file_was_wanted(new_store: Callable[[int], Store]) -> None:
    store = new_store(300_000)
    for i in range(6):
        store.put(key(i), layer(3 * i))
    before = store.snapshot()
    for i in range(6):
        store.put(key(i), layer(3 * (10 + i)) if i % 2 else None)
    store.put(key(9), layer(9))
    store.restore(before)
    assert all(same(store.get(key(i)), layer(3 * i)) for i in range(6))
    assert store.get(key(9)) is None
    del before
    size = store._file.end
    for i in range(40):
        store.put(key(i % 6), layer(3 * i))
    assert store._file.end <= size + 1.05 * layer(0).nbytes
