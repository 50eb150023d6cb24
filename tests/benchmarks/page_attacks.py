"""Attacks on the page of a flight: `python -m tests.benchmarks.page_attacks [--each SECONDS]` (20). Linux only.

The real program flies simulated pictures, with a limit of 1,024 open files for it and for its page's process. Meanwhile its page
is attacked from one loopback address (127.0.0.3), and then from a hundred, while somebody at another (127.0.0.2) asks for
status.json twice a second on new connections. A line for each attack, and for the quiet between: how many frames came, how late
they were done after they came, how many of the other's requests were answered and how fast, and what it cost. In the end:
triggers without a frame, frames that were not placed, and what was said on the terminal.
"""

from __future__ import annotations

import argparse
import http.client
import os
import re
import resource
import signal
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from sitl.flight import plan
from sitl.path import Plan
from tests.benchmarks.processes import cpu_of
from tests.ports import free_port
from tests.running import Running, events_of, flying, frames_of, until

SHOT_EVERY_S, ASK_EVERY_S = 3.0, 0.5
SETTINGS = "finish_s: 60\nstitch: {features: {count: 500}}\n"  # the page is what is tried here
FILES = 1024
ATTACKER, OTHER = "127.0.0.3", "127.0.0.2"
CROWD = [f"127.0.1.{n}" for n in range(1, 101)]
HALF = b"GET / HTTP/1.1\r\nHost: 1"
LIVE = b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
LARGE = b"GET /viewer/vendor/leaflet/leaflet.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
DONE = re.compile(r"gcs_mosaic\.app\.live\.daemon: (\S+): ([\d.]+) s after it came; ")


@dataclass
class Phase:
    """What happened between two moments."""

    name: str
    frames: list[str] = field(default_factory=list)  # that came
    answered: list[float] = field(default_factory=list)  # seconds
    refused: int = 0  # of the other's requests
    page_cpu: float = 0.0  # share of a core that the page's process took
    files: int = 0  # that the flight had open in the end

    def line(self, late: dict[str, float]) -> str:
        found = [late[name] for name in self.frames if name in late]
        frames = f"{len(found)} of {len(self.frames)} frames, {statistics.median(found):.1f} s late, at most {max(found):.1f} s"
        fast = (
            f"{1000 * statistics.median(self.answered):.0f} ms, at most {1000 * max(self.answered):.0f} ms"
            if self.answered
            else "-"
        )
        asked = len(self.answered) + self.refused
        costs = f"page {100 * self.page_cpu:.0f} % of a core, {self.files} files open in the flight"
        return f"{self.name:<42}{frames}; {len(self.answered)} of {asked} answered in {fast}; {costs}"


@dataclass
class Attacked:
    """A flight, its page's port, and somebody else who looks."""

    flight: Running
    port: int
    pictures: Iterator[bytes]
    phases: list[Phase] = field(default_factory=list)

    def during(self, name: str, seconds: float, attack: Callable[[int], object] | None = None) -> None:
        """Fly on for so long under an attack, which is a context of the page's port."""
        phase = Phase(name)
        self.phases.append(phase)
        with ExitStack() as stack:
            if attack is not None:
                stack.enter_context(in_background(lambda stop: keep_up(attack, self.port, stop)))
            stack.enter_context(in_background(lambda stop: ask(self.port, phase, stop)))
            page, began = page_of(self.flight), time.monotonic()
            used = cpu_of(page)
            self.fly_for(seconds, phase)
            phase.files = len(list(Path(f"/proc/{self.flight.process.pid}/fd").iterdir()))
            phase.page_cpu = max(0.0, cpu_of(page_of(self.flight)) - used) / (time.monotonic() - began)

    def fly_for(self, seconds: float, phase: Phase) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            due = time.monotonic() + SHOT_EVERY_S
            name = f"{self.flight.taken:04}.jpg"
            self.flight.take(name, next(self.pictures))
            phase.frames.append(name)
            while time.monotonic() < due:
                self.flight.vehicle.tick(None)
                time.sleep(0.02)


@contextmanager
def in_background(work: Callable[[threading.Event], None]) -> Iterator[None]:
    stop = threading.Event()
    thread = threading.Thread(target=work, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def keep_up(attack: Callable[[int], object], port: int, stop: threading.Event) -> None:
    """Attack again and again: what is cut off comes back."""
    held: list[object] = []
    while not stop.wait(0.2):
        held.append(attack(port))
        del held[:-3]


def ask(port: int, phase: Phase, stop: threading.Event) -> None:
    """As somebody at another address does."""
    while not stop.wait(ASK_EVERY_S):
        start = time.monotonic()
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10, source_address=(OTHER, 0))
        try:
            connection.request("GET", "/status.json")
            whole = len(connection.getresponse().read()) > 1000
        except (OSError, http.client.HTTPException):
            whole = False
        finally:
            connection.close()
        if whole:
            phase.answered.append(time.monotonic() - start)
        else:
            phase.refused += 1


class Held:
    """Connections, each with something sent on it, that are not read from and are closed with the object."""

    def __init__(self, port: int, count: int, sent: bytes, senders: list[str], buffer: int | None = None) -> None:
        self._sockets: list[socket.socket] = []
        for number in range(count):
            one = socket.socket()
            if buffer:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
            with suppress(OSError):
                one.settimeout(2)
                one.bind((senders[number % len(senders)], 0))
                one.connect(("127.0.0.1", port))
                one.sendall(sent)
            self._sockets.append(one)

    def __del__(self) -> None:
        for one in self._sockets:
            one.close()


class Once:
    """An attack that is begun once and held."""

    def __init__(self, count: int, sent: bytes, senders: list[str], buffer: int | None = None) -> None:
        self._what = (count, sent, senders, buffer)
        self._held: list[tuple[float, Held]] = []

    def __call__(self, port: int) -> None:
        if not self._held or time.monotonic() - self._held[-1][0] > 12:  # what was held is closed by then
            self._held = [(time.monotonic(), Held(port, *self._what))]


def kill_the_page(flight: Running) -> Callable[[int], None]:
    killed: set[int] = set()

    def kill(_: int) -> None:
        if not killed:
            killed.add(page_of(flight))
            os.kill(page_of(flight), signal.SIGKILL)

    return kill


def page_of(flight: Running) -> int:
    """The page's process, by its words."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == flight.process.pid and b"page_process" in (folder / "cmdline").read_bytes():
                return int(folder.name)
    raise LookupError("the page has no process")


def few_files(process: int) -> None:
    resource.prlimit(process, resource.RLIMIT_NOFILE, (FILES, FILES))


def attacked(home: Path, each_s: float) -> None:
    """Fly, and print the table."""
    shots = round(10 * (each_s + 3) / SHOT_EVERY_S)
    pictures = iter(
        list(plan("survey", (640, 480), seed=3, world_size=4096, route=Plan(frames=shots, height=60)).pictures())
    )
    with flying(home, "--http", f"0.0.0.0:{(port := free_port())}", config=SETTINGS) as flight:
        few_files(flight.process.pid)
        few_files(page_of(flight))
        run = Attacked(flight, port, pictures)
        run.during("before", each_s)
        run.during("1,100 half requests of one address", each_s, Once(1100, HALF, [ATTACKER]))
        run.during("1,100 half requests of 100 addresses", each_s, Once(1100, HALF, CROWD))
        run.during("200 slow readers", each_s, Once(200, LARGE * 20, [ATTACKER], buffer=2048))
        run.during("64 held /live", each_s, Once(64, LIVE, [ATTACKER]))
        run.during("64 held /live of 100 addresses", each_s, Once(64, LIVE, CROWD))
        run.during("page's process killed", each_s, kill_the_page(flight))
        run.during("after", each_s)
        until(lambda: flight.status()["frames_in_queue"] == 0, "all frames are done", 120)
        flight.end()
    late = {name: float(seconds) for name, seconds in DONE.findall((flight.out / "flight.log").read_text())}
    for phase in run.phases:
        print(phase.line(late))
    print(summary(flight))


def summary(flight: Running) -> str:
    events, frames = events_of(flight.out), [str(frame.state) for frame in frames_of(flight.out).values()]
    counts = ", ".join(f"{frames.count(state)} {state}" for state in sorted(set(frames)))
    said = [line for line in flight.said.splitlines() if "page" in line or "Traceback" in line]
    matched = f"{events.count('matched')} of {flight.taken} triggers matched"
    return "\n".join([f"{matched}; frames: {counts}; {len(flight.said)} characters on the terminal", *said])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.page_attacks")
    parser.add_argument("--each", type=float, default=20.0, help="seconds for each attack")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 8192)), hard))
    with tempfile.TemporaryDirectory() as home:
        attacked(Path(home), parser.parse_args().each)


if __name__ == "__main__":
    main()
