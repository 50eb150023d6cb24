"""Arrays that lie in a scratch file when there are too many for the memory."""

from __future__ import annotations

import pickle
import resource
import weakref
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.matching import match
from gcs_mosaic.store.array_shelf import ArrayShelf, ShelvedArray
from tests.sure import sure

MANY, BYTES = 40, 20_000


@pytest.fixture
def five(tmp_path: Path) -> Iterator[ArrayShelf]:
    """A shelf with room for five arrays in memory."""
    with closing(ArrayShelf(5 * BYTES, tmp_path)) as shelf:
        yield shelf


@pytest.fixture
def one(tmp_path: Path) -> Iterator[ArrayShelf]:
    """... for one."""
    with closing(ArrayShelf(BYTES, tmp_path)) as shelf:
        yield shelf


def arrays() -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    return [rng.integers(0, 255, (100 + number, 128), np.uint8) for number in range(MANY)]


def shelved_and_watched(
    shelf: ArrayShelf, some: list[np.ndarray]
) -> tuple[list[ShelvedArray], list[weakref.ref[np.ndarray]]]:
    """The arrays, which only the shelf has any more."""
    watched = [weakref.ref(array) for array in some]
    shelved = [shelf.shelve(some.pop(0)) for _ in range(len(some))]
    return shelved, watched


def bytes_in_memory(watched: list[weakref.ref[np.ndarray]]) -> int:
    return sum(array.nbytes for reference in watched if (array := reference()) is not None)


def test_all_come_back_and_few_are_in_memory(five: ArrayShelf, tmp_path: Path) -> None:
    shelved, watched = shelved_and_watched(five, arrays())
    assert 1 <= bytes_in_memory(watched) <= 5 * BYTES
    watched.clear()
    for one, array in zip(shelved, arrays(), strict=True):
        watched.append(weakref.ref(one.array()))
        assert np.array_equal(one.array(), array)
    assert 1 <= bytes_in_memory(watched) <= 5 * BYTES
    assert [one.shape for one in shelved] == [array.shape for array in arrays()]
    assert not list(tmp_path.iterdir())  # the file has no name


def test_what_nobody_has_any_more_takes_no_room(five: ArrayShelf) -> None:
    """Neither in memory nor in the file: a frame that was refused leaves nothing."""
    kept = [five.shelve(array) for array in arrays()[:3]]
    for _ in range(3):
        passing, watched = shelved_and_watched(five, arrays()[3:5])
        assert bytes_in_memory(watched) > 0
        del passing
        kept.append(five.shelve(arrays()[len(kept)]))  # what is gone is let go by the next that comes
        assert bytes_in_memory(watched) == 0
    assert all(np.array_equal(one.array(), array) for one, array in zip(kept, arrays(), strict=False))


def test_any_thread_may_ask(five: ArrayShelf) -> None:
    known = arrays()
    shelved = [five.shelve(array) for array in known]

    def asks(seed: int) -> bool:
        numbers = np.random.default_rng(seed).integers(0, MANY, 300)
        return all(np.array_equal(shelved[number].array(), known[number]) for number in numbers)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(asks, range(4)))


def test_what_nobody_refers_to_gives_its_place_back(one: ArrayShelf) -> None:
    """A file that may become half as large again as it must be for one round suffices for many."""
    alike = np.zeros((128, 128), np.uint8)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MANY * alike.nbytes * 3 // 2, limits[1]))
    try:
        for _ in range(3):
            shelved = [one.shelve(alike) for _ in range(MANY)]
            assert one.problem is None
            del shelved
        kept = [one.shelve(alike) for _ in range(2 * MANY)]
        assert one.problem is not None, "the limit is none"
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert all(np.array_equal(each.array(), alike) for each in kept)


def test_on_a_full_disk_nothing_is_lost(five: ArrayShelf, monkeypatch: pytest.MonkeyPatch) -> None:
    known = arrays()

    def full(_data: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(five._file, "write", full)
    shelved, watched = shelved_and_watched(five, arrays())
    assert bytes_in_memory(watched) > 5 * BYTES
    assert "No space left" in sure(five.problem)
    assert all(np.array_equal(one.array(), array) for one, array in zip(shelved, known, strict=True))
    monkeypatch.undo()
    five.shelve(known[0])
    assert five.problem is None
    assert bytes_in_memory(watched) <= 5 * BYTES


def test_what_cannot_be_read_matches_nothing_and_is_not_pickled(
    one: ArrayShelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = arrays()
    lost, _ = one.shelve(known[0]), [one.shelve(array) for array in known]

    def broken(_slot: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(one._file, "read", broken)
    features = Features(np.zeros((len(known[0]), 2), np.float32), lost, 640, 480, 1.0)
    assert not len(match(features.descriptors, known[0], 0.8))
    assert "Input/output" in sure(one.problem)
    with pytest.raises(OSError, match="Input/output"):
        pickle.dumps(features)


def test_features_on_a_shelf_are_pickled_with_all_they_hold(one: ArrayShelf) -> None:
    rng = np.random.default_rng(2)
    faint = rng.integers(-100, 100, (48, 64)).astype(np.int8)
    features = Features(rng.random((300, 2), np.float32), rng.integers(0, 255, (300, 128), np.uint8), 640, 480, 1.0)
    features = replace(features, kept_faint=faint, ordinary=100, sharpness=3.0)
    shelved = features.shelved(one.shelve)
    assert isinstance(shelved.kept_descriptors, ShelvedArray)
    again = pickle.loads(pickle.dumps(shelved))
    assert isinstance(again.kept_descriptors, np.ndarray)
    for same in (shelved, again):
        assert np.array_equal(same.descriptors, features.descriptors)
        assert np.array_equal(sure(same.faint), faint)
        assert (same.ordinary, same.sharpness, same.width) == (100, 3.0, 640)


def test_features_that_are_lost_are_said_to_be_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    shelf = ArrayShelf(0, tmp_path)
    for _ in range(2):
        shelf.note_lost(OSError("gone"))
    assert shelf.problem == "the scratch file of the features cannot be read: gone"
    assert [one.message for one in caplog.records] == ["features cannot be read back"]
    shelf.close()
