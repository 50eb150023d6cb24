"""The page's process may die, hang or be killed: the flight does not wait, and the page comes back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.processes import child as children
from gcs_mosaic.processes import keeper as keeping
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.page_keeper import PageKeeper
from gcs_mosaic.web.page_task import PageTask
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access
from tests.running import until
from tests.sure import sure
from tests.web.small_flight import SmallFlight
from tests.web.test_app import Client, Live

pytestmark = pytest.mark.skipif(os.name != "posix", reason="processes are stopped and killed by signals")

TILE = Tile(16, 40_000, 40_000)


def task(root: Path, port: int = 0) -> PageTask:
    return PageTask(root=root, address=HttpAddress("127.0.0.1", port), access=Access(), settings=WebSettings())


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    SmallFlight(folder).write()
    return folder


@pytest.fixture(scope="module")
def keeper(root: Path) -> Iterator[PageKeeper]:
    kept = PageKeeper(task(root))
    yield kept
    kept.stop()


@pytest.fixture(scope="module")
def client(keeper: PageKeeper) -> Client:
    return Client(f"http://127.0.0.1:{keeper.start()}/")


def process_of(keeper: PageKeeper) -> int:
    until(lambda: keeper._child is not None, "it is started")
    return sure(keeper._child).pid


def said(keeper: PageKeeper) -> list[str]:
    return [notice.text for notice in keeper.news()]


def is_up(client: Client) -> bool:
    try:
        return client.status("/mosaic.json") == 200
    except OSError:
        return False


def test_beside_many_busy_programs_the_page_gives_way_and_still_has_time_to_answer(
    keeper: PageKeeper, client: Client
) -> None:
    """What Linux gives to a process by its niceness, beside five that want the same core: a twentieth of it or more, of which an
    answer takes some ms; and half of what each of the others has, or less."""
    until(lambda: is_up(client), "it is as nice as it is to be")
    beside = 1.25 ** -(os.getpriority(os.PRIO_PROCESS, process_of(keeper)) - os.getpriority(os.PRIO_PROCESS, 0))
    assert beside / (5 + beside) >= 0.05
    assert beside <= 0.5


@pytest.mark.long
def test_changes_reach_the_page_through_the_process(keeper: PageKeeper, client: Client) -> None:
    live = Live(client)
    assert live.message()["revision"] == 1
    keeper.publish(2, [(0, TILE), (0, TILE.parent)])
    assert live.message() == {"revision": 2, "tiles": [[0, *TILE]]}
    live.close()


@pytest.mark.long
def test_a_process_that_is_killed_is_replaced_at_the_same_port(keeper: PageKeeper, client: Client) -> None:
    killed = process_of(keeper)
    os.kill(killed, signal.SIGKILL)
    until(lambda: process_of(keeper) != killed and is_up(client), "the page is up again")
    until(lambda: keeper._news.qsize() == 2, "both is said")
    assert said(keeper) == [
        "the page's process has ended (SIGKILL): it is started again, and the flight goes on",
        "the page is there again",
    ]
    live = Live(client)
    live.message()
    keeper.publish(3, None)
    assert live.message() == {"revision": 3, "tiles": None}
    live.close()


@pytest.mark.long
def test_a_process_that_stands_still_is_waited_for_by_nobody(
    keeper: PageKeeper, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    hung = process_of(keeper)
    os.kill(hung, signal.SIGSTOP)
    start = time.monotonic()
    for number in range(300):
        keeper.publish(4 + number, [(0, Tile(16, number, each)) for each in range(100)])
    assert time.monotonic() - start < 3
    assert keeper._pending is None or keeper._pending.painted is None or len(keeper._pending.painted) <= 5000
    monkeypatch.setattr(keeping, "HUNG_S", 0.2)
    for _ in range(5):
        time.sleep(0.1)
        keeper.news()
    until(lambda: process_of(keeper) != hung and is_up(client), "it is replaced")


@pytest.mark.long
def test_ctrl_c_and_other_requests_to_end_are_not_for_the_page(keeper: PageKeeper, client: Client) -> None:
    process = process_of(keeper)
    assert os.getpgid(process) != os.getpgid(0)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(process, number)
    time.sleep(0.3)
    assert is_up(client)
    assert process_of(keeper) == process


@pytest.mark.long
def test_the_process_is_gone_when_the_flight_is(root: Path) -> None:
    """Killed, so that it can tell nobody."""
    program = f"""
import sys, time
from pathlib import Path
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.page_keeper import PageKeeper, PageTask
from gcs_mosaic.web.page_task import Access, WebSettings
address = HttpAddress("127.0.0.1", 0)
keeper = PageKeeper(PageTask(root=Path({str(root)!r}), address=address, access=Access(), settings=WebSettings()))
print(keeper.start(), keeper._child.pid, flush=True)
time.sleep(100)
"""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    flight = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, env=environment, text=True)
    assert flight.stdout is not None
    with flight:
        port, process = map(int, flight.stdout.readline().split())
        assert is_up(Client(f"http://127.0.0.1:{port}/"))
        flight.kill()
    until(lambda: not runs(process), "the page's process has ended")


def runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z" if Path("/proc").exists() else False
    except OSError:
        return False


@pytest.mark.long
def test_a_port_that_is_taken_is_refused_at_the_start(keeper: PageKeeper, client: Client, root: Path) -> None:
    port = int(client.netloc.split(":")[1])
    another = PageKeeper(task(root, port))
    with pytest.raises(UsageError, match=f"listens on 127.0.0.1:{port} already: choose --http 127.0.0.1:[0-9]+,"):
        another.start()
    another.stop()


def test_a_process_that_cannot_start_is_tried_again_less_and_less_often(
    root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(keeping, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr(children, "PROGRAM", (sys.executable, "-c", "raise SystemExit('no memory')"))
    broken = PageKeeper(task(root))
    assert broken.start() is None
    until(lambda: caplog.text.count("no memory") >= 3, "it is tried again")
    assert len(said(broken)) == 1
    broken.publish(1, None)
    broken.stop()
