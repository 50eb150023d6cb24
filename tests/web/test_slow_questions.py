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
from gcs_mosaic.web.api.common import THREADS, OneThread
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
