"""The page of a real flight, in a real browser: whatever is killed, what was shown stays, and goes on by itself."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.benchmarks.page_attacks import page_of
from tests.ports import free_port
from tests.running import Running, flying, until
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.test_app import Client

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not Path("/proc").exists(), reason="processes are looked up in /proc"),
]

TILES = "[...document.querySelectorAll('.leaflet-tile img')].filter(i => i.complete && i.naturalWidth > 1).length"
COUNTS = "document.getElementById('counts')?.textContent"
PLACED = f"Number(/Frames placed\\s*(\\d+)/i.exec({COUNTS} ?? '')?.[1] ?? 0)"


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    with open_browser(tmp_path / "profile") as opened:
        opened.resize(1280, 800)
        yield opened


def fly_on(flight: Running, pictures: list[bytes], numbers: range) -> None:
    for number in numbers:
        flight.take(f"{number}.jpg", pictures[number])
    flight.wait_for_frames(placed=numbers.stop)


def is_gone(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.thorough
def test_the_map_stays_on_the_page_and_goes_on_by_itself(page: Page, tmp_path: Path, pictures: list[bytes]) -> None:
    words = ["--http", f"127.0.0.1:{free_port()}"]
    with flying(tmp_path, *words) as flight:
        fly_on(flight, pictures, range(2))
        page.open(f"http://{words[1]}/")
        page.wait_for(f"{PLACED} === 2 && {TILES} > 0", 20)
        page.evaluate("window.sameDocument = true")
        os.kill(killed := page_of(flight), signal.SIGKILL)
        fly_on(flight, pictures, range(2, 3))
        page.wait_for(f"{PLACED} === 3", 30)
        until(lambda: "the page is there again" in flight.said, "it is said")
        assert flight.said.count("the page's process has ended (SIGKILL)") == 1
        assert page_of(flight) != killed
        fly_on(flight, pictures, range(3, 4))
        page.wait_for(f"{PLACED} === 4", 30)
        last = page_of(flight)
        flight.process.kill()
        flight.process.wait()
    until(lambda: is_gone(last), "the page's process is gone with the flight")
    assert page.evaluate(f"{TILES} > 0 && {PLACED} === 4 && window.sameDocument")
    with flying(tmp_path, *words, "--resume") as flight:
        fly_on(flight, pictures, range(4, 5))
        page.wait_for(f"{PLACED} === 5 && document.getElementById('alarm').hidden", 30)
        assert page.evaluate(f"{TILES} > 0 && window.sameDocument")


@pytest.mark.thorough
def test_the_page_is_served_until_the_final_map_is_painted(tmp_path: Path, pictures: list[bytes]) -> None:
    """Ctrl-C in a terminal is a signal to the program and to all that it has started."""
    port = free_port()
    with flying(tmp_path, "--http", f"127.0.0.1:{port}") as flight:
        fly_on(flight, pictures, range(4))
        client, process = Client(f"http://127.0.0.1:{port}/"), page_of(flight)
        os.kill(process, signal.SIGINT)
        flight.process.send_signal(signal.SIGINT)
        states = set()
        while not is_gone(process):
            try:
                _, body = client.ask("/status.json")
            except OSError:
                break
            states.add(body.split(b'"state":"')[1].split(b'"')[0].decode())
        assert states & {"settling", "stopped"}
        assert flight.process.wait(60) == 0
        assert "the page's process" not in flight.said


@pytest.mark.thorough
def test_others_are_let_in_again_after_a_crash(tmp_path: Path) -> None:
    words, settings = ["--http", f"0.0.0.0:{free_port()}"], "finish_s: 20\nweb: {qr: always}\n"
    tokens = set()
    for _ in range(2):  # the second flight is written beside the first
        with flying(tmp_path, *words, config=settings) as flight:
            if "on no network" in flight.said:
                pytest.skip("this machine is on no network")
            assert "▀" in flight.said
            tokens.add(flight.said.split("?token=")[1].split()[0])
            flight.process.kill()
            flight.process.wait()
    (token,) = tokens
    for name in ("flight.log", "status.json"):
        assert token not in (flight.out / name).read_text()
