"""The readers bear what the search begins with, and small changes of it. The search itself is `python -m tests.fuzz`."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.fuzz import judging
from tests.fuzz.judging import judged
from tests.fuzz.targets import TARGETS

CHANGED = 10  # of each seed


def changes(data: bytes, seed: int) -> list[bytes]:
    """Cut, with bytes changed, with a part twice."""
    random, found = np.random.default_rng(seed), list[bytes]()
    for _ in range(CHANGED):
        changed = bytearray(data)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            changed[at] = random.choice([0, 1, 0x7F, 0x80, 0xFF, changed[at] ^ 1 << random.integers(8)])
        first, last = sorted(random.integers(0, len(data) + 1, 2))
        found += [bytes(changed), data[:first], data[:last] + data[first:]]
    return found


@pytest.mark.parametrize("name", TARGETS)
def test_a_reader_bears_what_is_nearly_whole(name: str) -> None:
    target = TARGETS[name]
    for number, seed in enumerate(target.seeds()):
        assert len(seed) <= target.longest
        for data in (seed, *changes(seed, number)):
            assert judged(target.read, data) is None, data


def test_what_is_a_find(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judging, "LONGEST_S", 1.0)
    monkeypatch.setattr(judging, "MOST_MB", 50.0)

    def large(_data: bytes) -> None:
        np.ones(80 << 17)

    def slow(_data: bytes) -> None:
        end = time.process_time() + 2
        while time.process_time() < end:
            pass

    def wrong(data: bytes) -> None:
        raise KeyError(data)

    found = [judged(read, b"") for read in (wrong, slow, large)]
    assert [one and one.kind for one in found] == ["KeyError", "TooLong", "large"]
    assert judged(len, b"") is None
