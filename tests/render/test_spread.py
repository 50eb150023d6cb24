"""Work spread over threads comes back in order, and only a little of it is begun ahead."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from gcs_mosaic.render.spread import AHEAD, ahead


def slower_at_first(number: int) -> int:
    time.sleep(0.02 if number % 2 == 0 else 0)
    return number


def test_results_come_in_order_and_few_works_are_begun_ahead() -> None:
    begun: list[int] = []

    def works() -> Iterator[Callable[[], int]]:
        for number in range(12):
            begun.append(number)
            yield partial(slower_at_first, number)

    with ThreadPoolExecutor(2) as pool:
        for asked, found in enumerate(ahead(pool, works())):
            assert found == asked
            assert len(begun) <= asked + 1 + AHEAD


def test_an_error_of_a_work_is_met_at_its_result() -> None:
    def broken() -> int:
        raise ValueError("a broken work")

    with ThreadPoolExecutor(2) as pool:
        works: list[Callable[[], int]] = [partial(int, 1), broken, partial(int, 3)]
        results = ahead(pool, works)
        assert next(results) == 1
        with pytest.raises(ValueError, match="a broken work"):
            next(results)
