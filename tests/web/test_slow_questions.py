"""What decodes, or waits for another's map, keeps no quick question waiting."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.thermal_scale import ThermalScale, ThermalScales
from gcs_mosaic.web.api import handed_over
from gcs_mosaic.web.api.common import THREADS, OneThread, steadily
from gcs_mosaic.web.api.detection import Measuring
from tests.handover.gapped import gapped_flight
from tests.web.served import served
from tests.web.test_app import Client


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with served(gapped_flight(tmp_path / "flight")) as url:
        yield Client(url)


class Held:
    """Work that takes until it is let go."""

    def __init__(self) -> None:
        self.begun, self.may_end = threading.Semaphore(0), threading.Event()

    def file(self, *_: object) -> str:
        self._wait()
        raise UsageError("nothing")

    def scale(self, *_: object) -> tuple[int, ThermalScale | None]:
        self._wait()
        return 1, None

    def _wait(self) -> None:
        self.begun.release()
        self.may_end.wait(10)


@pytest.mark.parametrize("path", ["/api/v1/mission.plan?below=0.5", "/api/v1/islands/0/thermal"])
def test_as_many_slow_ones_as_there_are_threads_leave_quick_ones_alone(
    client: Client, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    held = Held()
    monkeypatch.setattr(handed_over, "_file", held.file)
    monkeypatch.setattr(ThermalScales, "of", held.scale)
    asking = [threading.Thread(target=client.ask, args=(path,)) for _ in range(THREADS)]
    for one in asking:
        one.start()
    try:
        assert all(held.begun.acquire(timeout=5) for _ in asking)
        assert client.status("/api/v1/layers") == 200  # in less than the client's 5 s
    finally:
        held.may_end.set()
        for one in asking:
            one.join(5)


def test_who_comes_while_many_wait_is_told_so_and_others_are_served() -> None:
    async def ask() -> None:
        thread, may_end = OneThread("slow", 2), threading.Event()
        waiting = [asyncio.ensure_future(thread.run(may_end.wait, 10)) for _ in range(2)]
        await asyncio.sleep(0)
        with pytest.raises(web.HTTPServiceUnavailable):
            await thread.run(may_end.is_set)
        may_end.set()
        assert await asyncio.gather(*waiting) == [True, True]
        assert await thread.run(may_end.is_set)
        thread.end()

    asyncio.run(ask())


def test_what_fails_once_is_done_again_the_next_time() -> None:
    """As while a flight's folder is away: measuring goes on when it is back."""

    async def watch() -> list[str]:
        done = list[str]()

        async def step() -> bool:
            done.append("tried")
            if len(done) == 1:
                raise UsageError("The ledger cannot be read.")
            return len(done) < 3

        task = asyncio.ensure_future(steadily(step, 0.01))
        while len(done) < 4 and not task.done():
            await asyncio.sleep(0.01)
        task.cancel()
        return done

    assert len(asyncio.run(watch())) >= 4


def test_measuring_goes_on_after_a_step_that_failed() -> None:
    class Failing:
        steps = 0

        def step(self) -> bool:
            self.steps += 1
            if self.steps == 1:
                raise UsageError("The ledger cannot be read.")
            return True

        def forget_pictures(self) -> None: ...

    async def watch(found: Failing) -> None:
        measuring = Measuring(found)  # type: ignore[arg-type]
        measuring.note_asked()
        task = asyncio.ensure_future(measuring.for_ever())
        while found.steps < 3 and not task.done():
            await asyncio.sleep(0.01)
        task.cancel()
        measuring.end()

    failing = Failing()
    asyncio.run(watch(failing))
    assert failing.steps >= 3


def test_what_was_begun_is_finished_for_somebody_who_left() -> None:
    async def leave() -> bool:
        thread, may_end, done = OneThread("slow", 2, finishes=True), threading.Event(), threading.Event()
        first = asyncio.ensure_future(thread.run(may_end.wait, 10))
        second = asyncio.ensure_future(thread.run(done.set))
        await asyncio.sleep(0.01)
        second.cancel()
        may_end.set()
        await first
        is_done = await thread.run(done.wait, 5)
        thread.end()
        return is_done

    assert asyncio.run(leave())
