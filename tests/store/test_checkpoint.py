"""What is saved of a flight comes back as it was, is never half, and names no code."""

from __future__ import annotations

import errno
import io
import math
import os
import pickle
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import AnyArray
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.graph.view_graph import Link
from gcs_mosaic.store.checkpoint import (
    LARGE,
    NAME,
    VALUES_NAME,
    Checkpoints,
    Unusable,
    _Reader,
    _write_whole,
    decoded,
    encoded,
)
from gcs_mosaic.store.pickle_bounds import Unbounded

NEVER: Callable[[], None] = lambda: None  # noqa: E731
NONE = np.empty((0, 2), np.uint32)


def link(seed: int) -> Link:
    pixels = np.random.default_rng(seed).random((40, 2))
    return Link(pixels, pixels + 1, NONE, NONE, NONE)


def written(out: Path, state: object, checkpoints: Checkpoints | None = None) -> Checkpoints:
    checkpoints = checkpoints or Checkpoints(out, (Link,))
    checkpoints.write(lambda: state, NEVER, at_once=True)
    return checkpoints


def loaded(out: Path) -> Any:
    with closing(Checkpoints(out, (Link,))) as checkpoints:
        return checkpoints.load()


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    small, large = np.arange(5.0), np.arange(LARGE, dtype=np.uint8)
    state = {
        "values": (1, "a", None, b"b", {3}, frozenset({4}), [Pose(1.0, 2.0)], Camera(4, 3)),
        "mapping": MappingProxyType({1: 2}),
        "arrays": {"small": small, "large": large, "again": large},
        "links": {(0, 1): link(1), (1, 2): link(2)},
    }
    written(tmp_path, state).close()
    found = loaded(tmp_path)
    assert found["values"] == state["values"]
    assert dict(found["mapping"]) == {1: 2}
    assert np.array_equal(found["arrays"]["small"], small)
    assert np.array_equal(found["arrays"]["large"], large)
    assert found["arrays"]["large"] is found["arrays"]["again"]
    assert np.array_equal(found["links"][1, 2].pixels_a, link(2).pixels_a)


def test_large_values_are_written_once_also_after_a_restart(tmp_path: Path) -> None:
    links, values = [link(1)], tmp_path / VALUES_NAME
    checkpoints = written(tmp_path, links)
    size = values.stat().st_size
    written(tmp_path, links, checkpoints).close()
    assert values.stat().st_size == size
    with closing(Checkpoints(tmp_path, (Link,))) as again:
        links = again.load()
        links.append(link(2))
        written(tmp_path, links, again)
    assert size < values.stat().st_size < 2.1 * size
    assert [
        np.array_equal(one.pixels_a, link(seed).pixels_a) for one, seed in zip(loaded(tmp_path), (1, 2), strict=True)
    ]


def test_a_checkpoint_that_could_not_be_written_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoints = written(tmp_path, [link(1)])

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    for broken in ("append", "ledger"):
        with monkeypatch.context() as patch:
            if broken == "append":
                patch.setattr(os, "fsync", full)
            checkpoints.write(lambda: [link(2)], full if broken == "ledger" else NEVER, at_once=True)
        assert checkpoints.problem is not None
        assert np.array_equal(loaded(tmp_path)[0].pixels_a, link(1).pixels_a)
    written(tmp_path, [link(3)], checkpoints).close()
    assert checkpoints.problem is None
    assert np.array_equal(loaded(tmp_path)[0].pixels_a, link(3).pixels_a)


def test_the_ledger_is_on_the_disk_before_a_checkpoint_counts(tmp_path: Path) -> None:
    there: list[bool] = []
    with closing(Checkpoints(tmp_path, (Link,))) as checkpoints:
        checkpoints.write(lambda: [], lambda: there.append((tmp_path / NAME).exists()), at_once=True)
    assert there == [False]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "of another", "no values", "values cut"])
def test_a_damaged_checkpoint_is_a_reason(tmp_path: Path, damage: str) -> None:
    written(tmp_path, [link(1)]).close()
    file, values = tmp_path / NAME, tmp_path / VALUES_NAME
    data = file.read_bytes()
    if damage in ("cut", "flipped", "empty"):
        file.write_bytes({"cut": data[:-3], "flipped": data[:-3] + b"x" + data[-2:], "empty": b""}[damage])
    elif damage == "of another":
        values.write_bytes(bytes(16) + values.read_bytes()[16:])
    elif damage == "no values":
        values.unlink()
    else:
        values.write_bytes(values.read_bytes()[:-9])
    assert isinstance(loaded(tmp_path), Unusable)


def test_no_checkpoint_is_a_reason(tmp_path: Path) -> None:
    assert loaded(tmp_path) == Unusable("it has no checkpoint")


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch stolen",)


@dataclass(frozen=True)
class Foreign:
    value: int


@pytest.mark.parametrize("hostile", [Evil(), Foreign(1), pickle.loads, Path.unlink, np.load])
@pytest.mark.parametrize("where", ["state", "value"])
def test_a_checkpoint_names_no_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hostile: object, where: str
) -> None:
    monkeypatch.chdir(tmp_path)
    pixels: AnyArray = np.empty(1, object)
    pixels[0] = hostile
    written(tmp_path, [hostile] if where == "state" else [Link(pixels, pixels, NONE, NONE, NONE)]).close()
    found = loaded(tmp_path)
    assert isinstance(found, Unusable)
    assert "does not belong into a checkpoint" in found.reason
    assert not Path("stolen").exists()


def test_what_a_module_of_ours_imports_is_none_of_its_records() -> None:
    for name in ("Enum", "np.lib.npyio.NpzFile", "dataclass"):
        data = b"\x80\x04" + b"".join(
            b"\x8c" + bytes([len(part)]) + part for part in (b"gcs_mosaic.store.checkpoint", name.encode())
        )
        with pytest.raises(pickle.UnpicklingError, match="does not belong into a checkpoint"):
            _Reader(io.BytesIO(data + b"\x93."), lambda place: place).load()


class Reluctant(io.BytesIO):
    """A disk that takes a part of what it is given."""

    def write(self, data: Any) -> int:
        return super().write(data[:3])


def test_a_disk_that_takes_a_part_is_given_the_rest() -> None:
    file = Reluctant()
    _write_whole(file, b"more than three")
    assert file.getvalue() == b"more than three"


def test_what_cannot_be_saved_ends_no_flight_and_harms_no_later_checkpoint(tmp_path: Path) -> None:
    with closing(written(tmp_path, [link(1)])) as checkpoints:
        written(tmp_path, [link(2), lambda: None], checkpoints)
        assert checkpoints.problem is not None
        written(tmp_path, [link(1), link(3)], checkpoints)
        assert checkpoints.problem is None
    assert np.array_equal(loaded(tmp_path)[1].pixels_a, link(3).pixels_a)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(12.0).reshape(3, 4)[:, ::2],
        np.float32(1.5),
        np.array([True, False]),
    ],
)
def test_what_is_encoded_is_decoded_with_its_layout(array: np.ndarray) -> None:
    (found,) = decoded(encoded((array,)))
    assert np.array_equal(found, array)
    assert found.dtype == array.dtype
    wants_f = array.ndim > 1 and array.flags.f_contiguous
    assert bool(found.ndim > 1 and found.flags.f_contiguous) is wants_f


def nested(deep: int) -> tuple[Any, ...]:
    found: tuple[Any, ...] = ()
    for _ in range(deep - 1):
        found = (found,)
    return found


def test_values_are_a_hundred_deep_and_no_deeper() -> None:
    assert decoded(encoded(nested(100))) == nested(100)
    with pytest.raises(Unbounded, match="too deep"):
        decoded(encoded(nested(101)))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda data: b"something else", "is none of ours"),
        (lambda data: data[:40], "is none of ours"),
        (lambda data: data[:22] + b"\x09" + data[23:], "was written by another version of the program"),
        (lambda data: data[:30] + bytes([data[30] ^ 1]) + data[31:], "was written by another version of the program"),
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "is damaged"),
    ],
)
def test_a_checkpoint_that_is_none_asks_to_stitch_again(
    tmp_path: Path, change: Callable[[bytes], bytes], reason: str
) -> None:
    """Where there is none at all, the ledger tells what became of its flight."""
    with closing(Checkpoints(tmp_path)) as none:
        assert none.load() == Unusable("it has no checkpoint", stitch_again=False)
        none.write(lambda: (1, 2, 3), lambda: None, at_once=True)
    with closing(Checkpoints(tmp_path)) as whole:
        assert whole.load() == (1, 2, 3)
    path = tmp_path / "checkpoint"
    path.write_bytes(change(path.read_bytes()))
    with closing(Checkpoints(tmp_path)) as broken:
        is_another = "another version" in reason
        assert broken.load() == Unusable(f"its checkpoint {reason}", stitch_again=True, of_another_version=is_another)


def test_a_checkpoint_is_written_when_it_is_due_or_at_once(tmp_path: Path) -> None:
    def last() -> object:
        with closing(Checkpoints(tmp_path, read_only=True)) as reader:
            return reader.load()

    with closing(Checkpoints(tmp_path)) as written:
        written.write(lambda: (1,), lambda: None)
        written._wait()
        assert last() == (1,)
        written._due = math.inf
        written.write(lambda: (2,), lambda: None)
        written._wait()
        assert last() == (1,)
        written.write(lambda: (3,), lambda: None, at_once=True)
        assert last() == (3,)
