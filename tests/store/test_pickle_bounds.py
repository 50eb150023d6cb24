"""What crafted checkpoints may cost: next to nothing, and never more than a refusal."""

from __future__ import annotations

import hashlib
import os
import pickle
import resource
import subprocess
import sys
import time
from collections import Counter, OrderedDict, deque
from contextlib import closing, suppress
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_mosaic.check.check import check_checkpoint
from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.store.checkpoint import (
    HEAD,
    MAGIC,
    NAME,
    VALUES_NAME,
    Checkpoints,
    Unusable,
    decoded,
    encoded,
    program_digest,
)
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.pickle_bounds import Budget, Unbounded, refuse_unbounded

NAME_OF_VALUES = bytes(16)
PROTO = b"\x80\x05"


def _named(*names: str) -> bytes:
    return b"".join(b"\x8c" + bytes([len(one)]) + one.encode() for one in names) + b"\x93"


RECORD = _named("gcs_mosaic.stitch.camera.geometry", "Pose")
REFERENCE = _named(Checkpoints.__module__, "_reference")
TWICE_EACH = b"".join(b"h" + bytes([k]) + b"h" + bytes([k]) + b"\x86\x94" for k in range(60))
BOMBS = {
    "memo of a billion places": b"Nr\xff\xff\xff\x0f.",
    "memo of many places": b"Nq\xff.",
    "memo in text": b"Np999999999\n.",
    "tuples of the same, hashed": PROTO + b"K\x01\x94" + TWICE_EACH + b"}h\x3cNs.",
    "tuples of the same, in a set": PROTO + b"K\x01\x94" + TWICE_EACH + b"\x8f(h\x3c\x90.",
    "lists of the same": PROTO + b"]\x94" + b"".join(b"](h%ch%ce\x94" % (k, k) for k in range(60)) + b".",
    "a million deep": PROTO + b"N" + b"\x85" * 1_000_000 + b".",
    "a million deep, hashed": PROTO + b"}N" + b"\x85" * 1_000_000 + b"Ns.",
    "lists many deep": PROTO + b"]" * 100_000 + b"a" * 99_999 + b".",
    "a list in itself": PROTO + b"]\x94h\x00a.",
    "a dict that a tuple holds is filled": PROTO + b"}\x94h\x00\x85\x940h\x00NNs.",
    "sets without end": PROTO + b"(" + b"\x8f" * 700_000 + b"t.",
    "bytes that are not there": PROTO + b"\x8e" + (1 << 40).to_bytes(8, "little") + b"x.",
    "an array that is not there": PROTO + b"\x96" + (1 << 40).to_bytes(8, "little") + b"x.",
    "a frame that is not there": PROTO + b"\x95" + (1 << 60).to_bytes(8, "little") + b"N.",
    "a number of a million digits": PROTO + b"\x8b" + (500_000).to_bytes(4, "little") + b"\x7f" * 500_000 + b".",
    "the state of a class": PROTO + RECORD + b"N}\x8c\x01xK\x01s\x86b.",
    "a value that is called": PROTO + b"N)R.",
    "nothing": b"",
    "no end": PROTO + b"N",
    "taken from nothing": PROTO + b"\x87.",
    "marks": PROTO + b"(" * 1000 + b"t" * 1001 + b".",
    "more behind the end": PROTO + b"N.N.",
}


def written(folder: Path, body: bytes, values: bytes = NAME_OF_VALUES) -> Path:
    """A checkpoint whose sums are right."""
    head = HEAD.pack(2, program_digest(), hashlib.blake2b(body, digest_size=16).digest(), NAME_OF_VALUES, len(values))
    (folder / NAME).write_bytes(MAGIC + head + body)
    (folder / VALUES_NAME).write_bytes(values)
    return folder


def loaded(folder: Path) -> object:
    with closing(Checkpoints(folder, read_only=True)) as checkpoints:
        return checkpoints.load()


@pytest.mark.long
@pytest.mark.parametrize("name", BOMBS)
def test_crafted_checkpoints_are_damaged_ones(tmp_path: Path, name: str) -> None:
    """A checkpoint of 9 bytes cost 4.2 GB in `check`, and was called whole."""
    start = time.process_time()
    found = loaded(written(tmp_path, BOMBS[name]))
    assert isinstance(found, Unusable)
    assert found.stitch_again
    assert len(found.reason) < 300
    assert time.process_time() - start < 10


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="measures the memory as Linux tells it")
def test_crafted_checkpoints_cost_no_memory(tmp_path: Path) -> None:
    """All of them in one process of its own, whose highest memory is measured."""
    for k, body in enumerate(BOMBS.values()):
        (tmp_path / str(k)).mkdir()
        written(tmp_path / str(k), body)
    script = (
        "import resource, sys; from pathlib import Path; from tests.store.test_pickle_bounds import loaded, Unusable\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "assert all(isinstance(loaded(one), Unusable) for one in Path(sys.argv[1]).iterdir())\n"
        "print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10)"
    )
    limits = (8 << 30, 8 << 30)
    told = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limits),
    )
    assert int(told.stdout) < 200  # MB


@pytest.mark.parametrize("place", [0, -1, 1 << 40])
@pytest.mark.parametrize("length", [0, -1, -(1 << 62), 1 << 62, 50, 3])
def test_values_that_are_not_there(tmp_path: Path, place: int, length: int) -> None:
    body = PROTO + REFERENCE + b"\x8a\x08" + place.to_bytes(8, "little", signed=True) + b"\x85R."
    values = NAME_OF_VALUES + length.to_bytes(8, "little", signed=True) + b"Nr\xff\xff\xff\x0f."
    assert isinstance(loaded(written(tmp_path, body, values)), Unusable)


def test_values_that_overlap(tmp_path: Path) -> None:
    """A thousand references into the same megabyte would be a gigabyte."""
    inner = b"\x8e" + (1 << 20).to_bytes(8, "little")
    value = PROTO + inner + bytes(1 << 20) + b"."
    many = b"".join(b"h\x00M" + place.to_bytes(2, "little") + b"\x85R" for place in range(0, 8000, 8))
    values = NAME_OF_VALUES + len(value).to_bytes(8, "little") * 1000 + value
    assert isinstance(loaded(written(tmp_path, PROTO + REFERENCE + b"\x94(" + many + b"t.", values)), Unusable)


@pytest.mark.parametrize("name", [NAME, VALUES_NAME])
def test_what_is_no_file_is_not_waited_for(tmp_path: Path, name: str) -> None:
    written(tmp_path, PROTO + b"N.")
    (tmp_path / name).unlink()
    os.mkfifo(tmp_path / name)
    assert isinstance(loaded(tmp_path), Unusable)


def test_a_file_larger_than_any_checkpoint_is_not_read(tmp_path: Path) -> None:
    with (written(tmp_path, PROTO + b"N.") / NAME).open("r+b") as file:
        file.truncate(1 << 40)
    found = loaded(tmp_path)
    assert isinstance(found, Unusable)
    assert "1024 MB are read at most" in found.reason


plain = (
    st.none() | st.booleans() | st.integers(-(1 << 63), 1 << 63) | st.floats(allow_nan=False) | st.text() | st.binary()
)
keys = st.text() | st.integers(-5, 5) | st.tuples(st.text(), st.text())
states = st.recursive(
    plain,
    lambda inner: st.one_of(
        st.lists(inner, max_size=5),
        st.lists(inner, max_size=5).map(tuple),
        st.dictionaries(keys, inner, max_size=5),
        st.dictionaries(keys, inner, max_size=5).map(OrderedDict),
        st.lists(inner, max_size=3).map(deque),
        st.dictionaries(keys, inner, max_size=3).map(MappingProxyType),
        st.frozensets(keys, max_size=5),
        st.sets(keys, max_size=5),
        st.lists(keys, max_size=5).map(Counter),
    ),
    max_leaves=20,
)


@pytest.mark.long
@settings(max_examples=80, deadline=None)
@given(states)
def test_all_that_is_written_is_read(state: object) -> None:
    assert decoded(encoded(state)) == state


def test_what_is_held_often_is_read() -> None:
    shared = np.arange(100.0)
    found = decoded(encoded([(shared, "name", (shared,)) for _ in range(1000)]))
    assert len(found) == 1000
    assert found[0][0] is found[999][2][0]


instructions = st.sampled_from([bytes([code]) for code in range(0x28, 0x98)]) | st.binary(max_size=9)


@settings(max_examples=200, deadline=None)
@given(st.lists(instructions, max_size=40).map(b"".join) | st.binary(max_size=200))
def test_any_bytes_are_refused_or_read(data: bytes) -> None:
    for body in (data, PROTO + data + b"."):
        try:
            refuse_unbounded(body)
        except Unbounded:
            continue
        with suppress(Exception):  # whatever a reader of damaged files has to expect
            decoded(body)


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_flipped_bytes_of_a_real_one_raise_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = bytearray(
        encoded({"pipeline": {"_processed": {"a.jpg": None}}, "arrays": [np.arange(9.0), (1, 2), {3, 4}]})
    )
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    loaded(written(tmp_path_factory.mktemp("flipped"), bytes(whole)))


def test_pickles_of_other_programs_are_refused() -> None:
    for protocol in range(4):
        with pytest.raises(Unbounded):
            refuse_unbounded(pickle.dumps([(1, 2), "a", {"b": 2.0}], protocol))


OF_NO_FLIGHT: tuple[object, ...] = (None, [], {"pipeline": {}}, {"pipeline": {"_processed": [[]]}})


@pytest.mark.parametrize("body", [BOMBS["memo of a billion places"], *map(encoded, OF_NO_FLIGHT)])
def test_check_calls_no_crafted_checkpoint_whole(tmp_path: Path, body: bytes) -> None:
    part = CheckedPart("checkpoint", "values")
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        check_checkpoint(written(tmp_path, body), ledger, part)
    assert part.faults


def test_a_budget_is_spent_to_its_end() -> None:
    budget = Budget(1)
    budget.spend((64 << 20) + 32)
    with pytest.raises(Unbounded):
        budget.spend(1)
