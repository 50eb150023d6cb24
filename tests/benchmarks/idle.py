"""A day of an idle daemon with pages open, a hundred times as fast: python -m tests.benchmarks.idle --hours 24

Its clock, and with it everything that it waits for, runs faster (libfaketime); the aircraft's heartbeats come as often as they
would. A few frames are flown first. Prints what the daemon and its processes hold every two hours of theirs. Linux only.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from sitl.flight import plan
from sitl.messages import Capture
from sitl.path import Plan
from sitl.vehicle import Vehicle
from tests.benchmarks.processes import PAGE, family
from tests.ports import free_port
from tests.running import PROGRAM, frames_of, until

FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")
TIMES = 100
PAGES = 5
FRAMES = 12
TOLD_EACH_H = 2.0
MORE_MB = 20.0  # that may be held at the end than after the first tenth of the time


class Held(NamedTuple):
    mb: float
    files: int
    threads: int
    processes: int

    def __str__(self) -> str:
        return f"{self.mb:.0f} MB, {self.files} files, {self.threads} threads, {self.processes} processes"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.idle")
    parser.add_argument("--hours", type=float, default=24.0)
    given = parser.parse_args()
    if not FAKETIME.exists():
        print("libfaketime is missing: apt-get install libfaketime", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="idle-") as folder:
        held = list(day(given.hours, Path(folder)))
    first, last = held[max(1, len(held) // 10)], held[-1]
    constant = all(now <= then for now, then in zip(last[1:], first[1:], strict=True)) and last.mb <= first.mb + MORE_MB
    print("constant" if constant else f"NOT CONSTANT: {first} has become {last}")
    return 0 if constant else 1


def day(hours: float, home: Path) -> Iterator[Held]:
    """What the daemon and all that it has started hold, every so often."""
    port, page, over = free_port(), free_port(), threading.Event()
    with closing(Vehicle("127.0.0.1", port, ["camera"])) as vehicle, daemon(home, port, page) as process:
        fly(vehicle, home)
        threads = [threading.Thread(target=keep_alive, args=(vehicle, over))]
        threads += [threading.Thread(target=look_on, args=(page, over)) for _ in range(PAGES)]
        for thread in threads:
            thread.start()
        try:
            began = time.monotonic()
            while (passed := (time.monotonic() - began) * TIMES / 3600) < hours:
                time.sleep(TOLD_EACH_H * 3600 / TIMES)
                assert process.poll() is None, (home / "said.txt").read_text()
                held = held_by(process.pid)
                print(f"after {passed + TOLD_EACH_H:4.0f} h: {held}", flush=True)
                yield held
        finally:
            over.set()
            for thread in threads:
                thread.join()


@contextmanager
def daemon(home: Path, port: int, page: int) -> Iterator[subprocess.Popen[bytes]]:
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    environment |= {"LD_PRELOAD": str(FAKETIME), "FAKETIME": f"+0 x{TIMES}", "NO_FAKE_STAT": "1"}
    words = ["--mavlink", f"udp:127.0.0.1:{port}", "--http", f"127.0.0.1:{page}", "--from", "start"]
    with (home / "said.txt").open("wb") as said:
        process = subprocess.Popen([*PROGRAM, *words], cwd=home, env=environment, stderr=said)
        try:
            until(lambda: (home / "mosaic" / "status.json").exists(), "started")
            yield process
        finally:
            process.kill()
            process.wait()


def fly(vehicle: Vehicle, home: Path) -> None:
    (home / "frames").mkdir(exist_ok=True)
    for number, picture in enumerate(plan("survey", (640, 480), route=Plan(frames=FRAMES, height=60)).pictures()):
        vehicle.capture(Capture(index=number, name=f"{number}.jpg", state=None))
        (home / "frames" / "part").write_bytes(picture)
        (home / "frames" / "part").rename(home / "frames" / f"{number}.jpg")
    until(lambda: all(frame.state != "pending" for frame in frames_of(home / "mosaic").values()), "stitched")


def keep_alive(vehicle: Vehicle, over: threading.Event) -> None:
    """Heartbeats once a second of the daemon's time."""
    while not over.wait(1 / TIMES):
        vehicle.due["heartbeat"] = 0.0
        vehicle.tick(None)


def look_on(page: int, over: threading.Event) -> None:
    """A page: told of changes for as long as it is open, asking for the status twice a second of the daemon's time."""
    while not over.is_set():
        with suppress(OSError), socket.create_connection(("127.0.0.1", page), timeout=5) as live:
            live.sendall(b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            live.settimeout(0.2)
            while not over.is_set() and not ended(live):
                asked(page)


def ended(live: socket.socket) -> bool:
    try:
        return not live.recv(4096)
    except TimeoutError:
        return False


def asked(page: int) -> None:
    with suppress(OSError), socket.create_connection(("127.0.0.1", page), timeout=5) as one:
        one.sendall(b"GET /status.json HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        while one.recv(65536):
            pass


def held_by(process: int) -> Held:
    """What a process and all below it hold now."""
    found = Held(0.0, 0, 0, 0)
    for one in family(process):
        with suppress(OSError):  # it has just gone
            place = Path(f"/proc/{one}")
            resident = int((place / "statm").read_text().split()[1]) * PAGE / 2**20
            files, threads = (len(list((place / part).iterdir())) for part in ("fd", "task"))
            found = Held(found.mb + resident, found.files + files, found.threads + threads, found.processes + 1)
    return found


if __name__ == "__main__":
    sys.exit(main())
