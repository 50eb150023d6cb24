"""Parallel work on many tiles."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")

AT_ONCE = 8  # tiles per task: handing over costs as much as a tenth of a tile
AHEAD = 3  # tasks begun before their results are asked for: more take memory


def spread(pool: Executor, work: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Results of the work on each item, in order."""
    some = list(items)
    groups = [some[k : k + AT_ONCE] for k in range(0, len(some), AT_ONCE)]
    return [done for group in pool.map(lambda group: [work(one) for one in group], groups) for done in group]


def ahead(pool: Executor, works: Iterable[Callable[[], B]]) -> Iterator[B]:
    """Results of these works, in order. What each needs is brought by the iterable, in the thread that asks for the results."""
    begun: deque[Future[B]] = deque()
    for work in works:
        begun.append(pool.submit(work))
        if len(begun) > AHEAD:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()
