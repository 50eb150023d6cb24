"""Parallel work on many tiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")

AT_ONCE = 8  # tiles per task: handing over costs as much as a tenth of a tile


def spread(pool: Executor, work: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Results of the work on each item, in order."""
    some = list(items)
    groups = [some[k : k + AT_ONCE] for k in range(0, len(some), AT_ONCE)]
    return [done for group in pool.map(lambda group: [work(one) for one in group], groups) for done in group]
