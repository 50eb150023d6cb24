"""What many who look cost the stitching: python -m tests.benchmarks.tile_requests [FOLDER] [--pairs 3]

The real program stitches the frames of a folder, or of a simulated flight, as fast as it can, in turn alone and while 20 clients
ask for 200 tiles a second together; seconds of a frame, in pairs.
"""

from __future__ import annotations

import argparse
import http.client
import json
import random
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from sitl.flight import plan
from sitl.path import Plan
from tests.benchmarks import flown_live
from tests.ports import free_port

CLIENTS, PER_SECOND = 20, 200.0
SETTINGS = "web: {connections_per_address: 100}\n"


@dataclass
class Asked:
    """How many tiles were asked for, and how many came."""

    asked: int = 0
    came: int = 0
    seconds: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)


@contextmanager
def asking(port: int, out: Path) -> Iterator[Asked]:
    """Clients that ask for tiles of the map as it is, on connections that stay."""
    over, asked, began = threading.Event(), Asked(), time.monotonic()
    clients = [threading.Thread(target=_ask, args=(port, out, over, asked, n)) for n in range(CLIENTS)]
    for client in clients:
        client.start()
    try:
        yield asked
    finally:
        over.set()
        for client in clients:
            client.join()
        asked.seconds = time.monotonic() - began


def _ask(port: int, out: Path, over: threading.Event, asked: Asked, seed: int) -> None:
    chance, connection, known = random.Random(seed), None, list[str]()
    while not over.wait(CLIENTS / PER_SECOND):
        if not known or chance.random() < 0.005:
            known = [str(path.relative_to(out)) for path in (out / "tiles").rglob("*.*") if path.is_file()] or [
                "tiles/0/16/1/1"
            ]
        try:
            connection = connection or http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            connection.request("GET", f"/{chance.choice(known).rsplit('.', 1)[0]}")
            answer = connection.getresponse()
            answer.read()
        except (OSError, http.client.HTTPException):
            connection, answer = None, None
        with asked.lock:
            asked.asked += 1
            asked.came += answer is not None and answer.status == 200
    if connection is not None:
        connection.close()


def seconds_a_frame(pictures: list[Path], *, asked_for: bool) -> tuple[float, Asked]:
    """Of one flight, all frames brought at once."""
    port = free_port()
    with tempfile.TemporaryDirectory(prefix="tiles-") as folder:
        home = Path(folder)
        settings = f"{SETTINGS}http: 127.0.0.1:{port}\n"
        if not asked_for:
            return flown_live.fly(pictures, 0.0, home, settings, page=False, http=False).seconds_a_frame, Asked()
        with asking(port, home / "mosaic") as asked:
            found = flown_live.fly(pictures, 0.0, home, settings, page=False, http=False).seconds_a_frame
        return found, asked


def simulated(folder: Path) -> list[Path]:
    flight = plan("survey", (2000, 1500), route=Plan(frames=40, height=80))
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        (folder / Path(name).name).write_bytes(data)
    return flown_live.pictures_in(folder)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.tile_requests")
    parser.add_argument("folder", type=Path, nargs="?", help="pictures, instead of simulated ones")
    parser.add_argument("--pairs", type=int, default=3)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="pictures-") as made:
        pictures = flown_live.pictures_in(given.folder) if given.folder else simulated(Path(made))
        ratios = []
        for _ in range(given.pairs):
            alone, _ = seconds_a_frame(pictures, asked_for=False)
            beside, asked = seconds_a_frame(pictures, asked_for=True)
            ratios.append(beside / alone)
            told = {"asked a second": round(asked.asked / asked.seconds), "came": asked.came}
            print(
                f"{alone:.3f} s a frame alone, {beside:.3f} s beside: {beside / alone:.2f}; {json.dumps(told)}",
                flush=True,
            )
    print(f"median of the ratios {median(ratios):.2f}")


if __name__ == "__main__":
    main()
