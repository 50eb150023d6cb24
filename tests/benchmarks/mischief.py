"""What can go wrong around a flight, for the soak: each is begun, lasts some seconds, and is over.

Linux only; the disk that is full and the output folder's loss want the flight to be on a file system of its own (root).
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.mavlink.parser import dialect
from sitl.messages import Capture
from sitl.stream.camera import StreamingCamera
from sitl.vehicle import Vehicle
from tests.benchmarks.processes import family
from tests.running import PROGRAM, until
from tests.showing import Showing
from tests.sure import sure

WRONG_CLOCK = Path(__file__).parent / "wrong_clock"
HOUR_S = 3600.0
STARTS_S = 60.0
FORGED_EACH_S = 0.001
HALF_REQUESTS = 400
SHOWN_S = 0.7  # half the time between pictures
STREAM_BACK_S = 12.0  # until a stream that was lost is read again, at the latest: back-off, first key frame


@dataclass
class Soaked:
    """A daemon that is started again whenever it is killed, and what it is given. `folder` is on the disk that gets full.

    Pictures are written to a card, or shown to a streaming camera if there is one.
    """

    home: Path
    folder: Path
    port: int
    page: int
    vehicle: Vehicle
    settings: str
    own_disk: bool  # the folder is on a small disk of its own, which may be filled
    stream: StreamingCamera | None = None
    process: subprocess.Popen[bytes] | None = None
    link_up: bool = True
    taken: int = 0
    card: Path = field(init=False)  # where the camera writes, wherever the folder has gone
    showing: Showing | None = None
    streams_since: float = -inf
    busy: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.card = self.home / "frames"
        self.card.mkdir(parents=True, exist_ok=True)
        (self.home / "config.yaml").write_text(self.settings)

    @property
    def out(self) -> Path:
        return self.folder / "mosaic"

    @property
    def said(self) -> str:
        return (self.home / "said.txt").read_text(errors="replace")

    def start(self) -> None:
        """Start the daemon, and wait until it says what it watches."""
        words = ["--mavlink", f"udp:127.0.0.1:{self.port}", "--http", f"127.0.0.1:{self.page}", "--out", str(self.out)]
        words += ["--rtsp", self.stream.url] if self.stream else []
        path = os.pathsep.join(map(str, (WRONG_CLOCK, Path(__file__).parents[2])))
        environment = os.environ | {"PYTHONPATH": path, "WRONG_CLOCK": str(self.home / "clock")}
        ready = "is connected" if self.stream else "frames were there"
        before = self.said.count(ready) if (self.home / "said.txt").exists() else 0
        with (self.home / "said.txt").open("ab") as said:
            command = [*PROGRAM, *words, "--config", "config.yaml"]
            self.process = subprocess.Popen(command, cwd=self.home, env=environment, stderr=said)
        until(lambda: self.said.count(ready) > before or not self.runs, "started", STARTS_S)

    @property
    def runs(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def kill(self) -> None:
        """SIGKILL to the daemon."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def set_clock(self, off_s: float) -> None:
        (self.home / "clock").write_text(str(off_s))

    def shoot(self, name: str, picture: bytes) -> bool:
        """A picture is triggered and written to the card; returns whether the trigger was sent."""
        self.taken += 1
        heard = self.link_up and self.runs
        if self.showing is not None:
            self.showing.pictures[0] = sure(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR))
            time.sleep(SHOWN_S)  # the picture has come by then
            heard = self.link_up and self.runs and self.is_streaming
        if heard:
            self.vehicle.capture(Capture(index=self.taken, name=name, state=None))
        self.write(name, picture)
        return heard

    @property
    def is_streaming(self) -> bool:
        """Whether the camera's server runs, and has for long enough to be found again."""
        return self.stream is None or self.streams_since + STREAM_BACK_S < time.monotonic()

    def show(self, stream: StreamingCamera, first: NDArray[np.uint8]) -> None:
        """Fly with this camera instead of the card."""
        stream.start()
        self.stream, self.showing = stream, Showing(stream, [first])
        self.showing.start()

    def end_stream(self) -> None:
        if self.showing is not None and self.stream is not None:
            self.showing.over.set()
            self.showing.join()
            self.stream.kill()

    def write(self, name: str, data: bytes) -> None:
        with self.busy:
            beside = self.card / f"{name}.part"
            beside.write_bytes(data)
            beside.rename(self.card / name)


Mischief = Callable[[Soaked, random.Random], Iterator[None]]


def kill_daemon(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    soaked.kill()
    yield
    soaked.start()


def kill_child(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """One of the processes that the daemon has started."""
    assert soaked.process is not None, "started"
    children = [process for process in family(soaked.process.pid) if process != soaked.process.pid]
    if children:
        with suppress(ProcessLookupError):
            os.kill(chance.choice(children), signal.SIGKILL)
    yield


def suspend(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    assert soaked.process is not None, "started"
    stopped = family(soaked.process.pid)
    for process in stopped:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGSTOP)
    yield
    for process in stopped:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGCONT)


def full_disk(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    assert soaked.own_disk, "this would fill the disk of whoever runs it"
    filler = soaked.folder / "filler"
    with suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(1 << 16))
    yield
    filler.unlink(missing_ok=True)


def lost_output(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """Somebody removes the map's folder."""
    shutil.rmtree(soaked.out, ignore_errors=True)
    yield


def lost_card(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """The watched folder is gone for a while; the camera goes on writing into it."""
    with soaked.busy:
        away = soaked.home / "card"
        soaked.card.rename(away)
        soaked.card = away
    yield
    with soaked.busy:
        back = soaked.home / "frames"
        if back.exists():  # made again by the daemon
            shutil.rmtree(back)
        away.rename(back)
        soaked.card = back


def lost_link(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    soaked.link_up = False
    yield
    soaked.link_up = True


def wrong_clock(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    soaked.set_clock(chance.choice([HOUR_S, -24 * HOUR_S, 10 * 365 * 24 * HOUR_S]))
    yield
    soaked.set_clock(0.0)


def bad_files(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """Half a picture, text under a picture's name, a picture of elsewhere."""
    number, noise = f"{chance.randrange(10**6):06}", np.random.default_rng(chance.randrange(1000))
    picture = cv2.imencode(".jpg", cv2.resize(noise.integers(0, 255, (60, 80, 3), np.uint8), (640, 480)))[1].tobytes()
    soaked.write(f"half-{number}.jpg", picture[: len(picture) // 2])
    soaked.write(f"text-{number}.jpg", b"this is no picture")
    soaked.write(f"strange-{number}.jpg", picture)
    yield


def flood(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """Forged triggers in the aircraft's name from many components, for as long as it lasts."""
    over = threading.Event()
    thread = threading.Thread(target=_forge, args=(soaked.port, over))
    thread.start()
    yield
    over.set()
    thread.join()


def _forge(port: int, over: threading.Event) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", port))
        voices = [dialect.MAVLink(None, 1, component) for component in range(1, 40) if component != 1]
        number = 0
        while not over.wait(FORGED_EACH_S):
            voice, number = voices[number % len(voices)], number + 1
            message = dialect.MAVLink_camera_feedback_message(0, 1, 0, number, 0, 0, 0, 0, 0, 0, 0, 0, 0)
            with suppress(OSError):
                sender.send(message.pack(voice))


def half_requests(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    held = []
    for _ in range(HALF_REQUESTS):
        with suppress(OSError):
            one = socket.create_connection(("127.0.0.1", soaked.page), timeout=0.2)
            one.sendall(b"GET / HTTP/1.1\r\nHost: 1")
            held.append(one)
    yield
    for one in held:
        one.close()


def lost_stream(soaked: Soaked, chance: random.Random) -> Iterator[None]:
    """The camera's server is killed, and started again."""
    stream = sure(soaked.stream)
    soaked.streams_since = inf
    stream.kill()
    yield
    stream.start()
    soaked.streams_since = time.monotonic()


ALL: tuple[Mischief, ...] = (
    *(kill_daemon, kill_child, suspend, full_disk, lost_output, lost_card),
    *(lost_link, wrong_clock, bad_files, flood, half_requests),
)
# Nobody can give pictures of a stream again: whoever removes the map's folder has removed them.
OF_STREAMS: tuple[Mischief, ...] = (
    *(one for one in ALL if one not in (lost_card, bad_files, lost_output)),
    lost_stream,
)


def done(mischief: Mischief, soaked: Soaked, chance: random.Random, seconds: float) -> None:
    """One of them, from its beginning to its end."""
    steps = mischief(soaked, chance)
    next(steps)
    time.sleep(seconds)
    next(steps, None)


@contextmanager
def small_disk(megabytes: int, folder: Path) -> Iterator[bool]:
    """Make the folder a file system of its own; False if this user may not mount one."""
    folder.mkdir(parents=True, exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    mounted = subprocess.run(mount, check=False, capture_output=True).returncode == 0
    if not mounted:
        print("no disk of its own can be mounted: it will not get full", file=sys.stderr)
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", str(folder)], check=False)
