"""A large flight on the page: python -m tests.benchmarks.large_page

3,000 frames and 100,000 tiles in a real browser. Times between two pictures on the screen while the map is dragged and zoomed,
and the longest task; what comes over the network in a minute in which nothing changes, while the flight is on; and the memory of
the tab before and after the changes of a day: 3,000 frames more, each with 40 tiles. Linux only, as it reads /proc.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from tests.benchmarks.processes import family
from tests.web.browser import Page, open_browser
from tests.web.small_flight import MIDDLE, SmallFlight

FRAMES, SIDE = 3000, 316  # 316 x 316 tiles at the finest level
LEVELS = 16, 15, 14, 13, 12, 11, 10
MOVES = 120  # of the mouse in one drag
REST_S = 60.0
PER_FRAME = 40  # tiles that change with a frame
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
WATCH = """
window.times = []; window.longest = 0;
new PerformanceObserver((list) => { for (const one of list.getEntries()) longest = Math.max(longest, one.duration); })
  .observe({ entryTypes: ["longtask"] });
let last = performance.now();
const tick = (now) => { times.push(now - last); last = now; requestAnimationFrame(tick); };
requestAnimationFrame(tick); true
"""


def large_flight(root: Path) -> SmallFlight:
    """Frames on 50 lanes over 100,000 tiles, each column of which is one file by many names."""
    flight = SmallFlight(root)
    for number in range(FRAMES):
        lane, place = divmod(number, 60)
        flight.place(f"IMG_{number:05}.jpg", place * SIDE * 256 / 60, lane * SIDE * 256 / 50)
    for level in LEVELS:
        low = MIDDLE >> (16 - level)
        side = -(-SIDE // (1 << (16 - level)))
        for column in range(low, low + side):
            flight.paint(Tile(level, column, low), (90, 120 + column % 40, 80))
            folder = root / "tiles" / "0" / str(level) / str(column)
            for row in range(low + 1, low + side):
                (folder / f"{row}.jpg").hardlink_to(folder / f"{low}.jpg")
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, SIDE * 256, SIDE * 256), minzoom=10, maxzoom=16, frames=FRAMES)]
    flight.write()
    flight.status()
    return flight


def used(page: Page) -> None:
    """Drag and zoom, out and in, as somebody in a hurry."""
    for zoom in (-6, 8, 8, -3, 6, -12):
        for _ in range(abs(zoom)):
            wheel = {"x": 640, "y": 400, "deltaX": 0, "deltaY": -120 if zoom > 0 else 120}
            page.command("Input.dispatchMouseEvent", type="mouseWheel", **wheel)
            time.sleep(0.05)
        mouse(page, "mousePressed", 900, 500)
        for step in range(MOVES):
            mouse(page, "mouseMoved", 900 - 4 * step, 500 - 2 * step)
        mouse(page, "mouseReleased", 900 - 4 * MOVES, 500 - 2 * MOVES)
        time.sleep(0.5)


def mouse(page: Page, kind: str, x: float, y: float) -> None:
    page.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


def renderers_mb() -> float:
    """Of the largest process of the browser that shows pages, without what it shares with others."""
    return max(own_mb(one) for one in family(os.getpid()) if b"--type=renderer" in command_of(one))


def own_mb(process: int) -> float:
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) / 1024


def command_of(process: int) -> bytes:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


def day(flight: SmallFlight, feed: Feed, page: Page) -> None:
    """The changes of a day, in minutes."""
    rng = np.random.default_rng(1)
    for number in range(FRAMES):
        flight.place(f"LATE_{number:05}.jpg", *rng.uniform(0, SIDE * 256, 2).tolist())
        if number % 20:
            continue
        revision = flight.write()
        places = MIDDLE + rng.integers(0, SIDE, (PER_FRAME, 2))
        feed.publish(revision, [(0, Tile(16, int(x), int(y))) for x, y in places])
        flight.status()
        page.evaluate("1")
        time.sleep(0.2)


def alive(flight: SmallFlight, over: threading.Event) -> Iterator[None]:
    while not over.wait(1.0):
        flight.status()
        yield


def main() -> None:
    argparse.ArgumentParser(prog="python -m tests.benchmarks.large_page").parse_args()
    with tempfile.TemporaryDirectory(prefix="page-") as folder:
        root = Path(folder) / "flight"
        root.mkdir()
        flight, feed = large_flight(root), Feed()
        server = WebServer(root, HttpAddress("127.0.0.1", 0), feed)
        with open_browser(Path(folder) / "profile") as page:
            page.resize(1280, 800)
            began = time.monotonic()
            page.open(server.start())
            page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 8", 60)
            print(f"shown after {time.monotonic() - began:.1f} s", flush=True)
            page.evaluate(WATCH)
            used(page)
            times = np.array(page.evaluate("times"))
            half, most, worst = np.quantile(times, [0.5, 0.95, 1.0])
            longest = page.evaluate("longest")
            print(
                f"between two pictures {half:.0f} ms, 95 % {most:.0f} ms, at most {worst:.0f} ms; a task {longest:.0f} ms"
            )
            over, before = threading.Event(), page.received
            writer = threading.Thread(target=lambda: list(alive(flight, over)))
            writer.start()
            end = time.monotonic() + REST_S
            while time.monotonic() < end:
                page.evaluate("1")
                time.sleep(0.5)
            over.set()
            writer.join()
            print(f"at rest: {(page.received - before) / REST_S / 1000:.1f} KB/s", flush=True)
            early = renderers_mb()
            day(flight, feed, page)
            used(page)
            print(f"tab: {early:.0f} MB, after a day's changes {renderers_mb():.0f} MB")
            page.open("about:blank")
        server.stop()


if __name__ == "__main__":
    main()
