"""How far answers lie behind the map on a busy machine: `python -m tests.benchmarks.page_freshness [--load N] [--frames N]`.

The real program flies simulated pictures, one each second, beside so many processes that do nothing but count (10). Somebody
asks meanwhile who saw a place, for the gaps, and for a tile of the layer of looks, four times a second each. An answer tells
the revision of the map that it is of; it lies behind by as long as mosaic.json had told of a later one when it was asked for.
Printed: the median, 95 % and worst of that, and how long answers took.
"""

from __future__ import annotations

import argparse
import http.client
import json
import multiprocessing
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from sitl.flight import plan
from sitl.path import Plan
from tests.documents import document_at
from tests.ports import free_port
from tests.running import Running, flying

SHOT_EVERY_S, ASK_EVERY_S, LOOK_EVERY_S = 1.0, 0.25, 0.02
PATIENCE_S = 60.0  # after the last shot
SETTINGS = "finish_s: 60\nstitch: {features: {count: 500}}\n"  # the page is what is tried here
MIDDLE = 2**15  # column and row of the tile of level 16 at the canvas' origin
PATHS = {
    "sightings": "/api/v1/islands/0/sightings?x=0&y=0",
    "gaps": "/api/v1/islands/0/gaps",
    "layer": f"/api/v1/layers/looks/0/16/{MIDDLE}/{MIDDLE}.png",
}


@dataclass
class Asked:
    """Seconds, of each answer."""

    behind: list[float] = field(default_factory=list)
    took: list[float] = field(default_factory=list)
    failed: int = 0


@dataclass
class Told:
    """When mosaic.json first told of each revision, monotonic seconds."""

    since: dict[int, float] = field(default_factory=dict)

    def behind(self, revision: int, asked_at: float) -> float:
        later = [at for one, at in self.since.items() if one > revision and at <= asked_at]
        return asked_at - min(later) if later else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.page_freshness")
    parser.add_argument("--load", type=int, default=10)
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, busy(given.load):
        found = flown(Path(folder), given.frames)
    print(f"load of the machine meanwhile {os.getloadavg()[0]:.0f}")
    for name, one in found.items():
        behind, took = (sorted(values) for values in (one.behind, one.took))
        if not behind:
            print(f"{name}: no answer came, {one.failed} failed: the machine is too busy, or the page is not served")
            continue
        print(
            f"{name}: {len(behind)} answers, {one.failed} failed; behind {statistics.median(behind):.2f} s (median), "
            f"{behind[int(0.95 * len(behind))]:.2f} s (95 %), at most {behind[-1]:.2f} s; "
            f"answered after {statistics.median(took):.2f} s, at most {took[-1]:.2f} s"
        )


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes that want a core each."""
    counting = [multiprocessing.Process(target=count, daemon=True) for _ in range(processes)]
    for one in counting:
        one.start()
    try:
        yield
    finally:
        for one in counting:
            one.kill()


def count() -> None:
    while True:
        pass


def flown(home: Path, frames: int) -> dict[str, Asked]:
    port, over = free_port(), threading.Event()
    route = Plan(frames=frames, height=60)
    pictures = plan("survey", (640, 480), cache=home / "world", seed=3, world_size=2048, route=route).pictures()
    found, told = {name: Asked() for name in PATHS}, Told()
    with flying(home, "--http", f"127.0.0.1:{port}", config=SETTINGS) as flight:
        watcher = threading.Thread(target=watch, args=(flight.out, told, over))
        askers = [threading.Thread(target=ask, args=(port, name, found[name], told, over)) for name in PATHS]
        for one in (watcher, *askers):
            one.start()
        fly(flight, list(pictures)[:frames])
        over.set()
        for one in (watcher, *askers):
            one.join()
    return found


def fly(flight: Running, pictures: list[bytes]) -> None:
    for number, data in enumerate(pictures):
        flight.take(f"{number}.jpg", data)
        time.sleep(SHOT_EVERY_S)
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s and flight.status()["frames"]["placed"] < len(pictures):
        time.sleep(SHOT_EVERY_S)  # it may end behind


def watch(out: Path, told: Told, over: threading.Event) -> None:
    while not over.wait(LOOK_EVERY_S):
        with suppress(OSError, ValueError, KeyError):
            told.since.setdefault(int(document_at(out / "mosaic.json")["revision"]), time.monotonic())


def ask(port: int, name: str, found: Asked, told: Told, over: threading.Event) -> None:
    while not over.wait(ASK_EVERY_S):
        begun = time.monotonic()
        try:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
            connection.request("GET", PATHS[name])
            answer = connection.getresponse()
            data, told_beside = answer.read(), answer.getheader("Map-Revision")
            revision = int(told_beside) if told_beside else json.loads(data)["map_revision"]
        except (OSError, ValueError, KeyError, http.client.HTTPException):
            found.failed += 1
            continue
        found.took.append(time.monotonic() - begun)
        found.behind.append(told.behind(revision, begun))


if __name__ == "__main__":
    main()
