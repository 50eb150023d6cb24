"""A real live flight of a folder's frames: the program as a process, MAVLink over UDP, files into the watched folder, a page."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from gcs_mosaic.store.status import STATUS_NAME
from sitl.__main__ import free_port
from sitl.messages import Capture
from sitl.vehicle import Vehicle
from tests.benchmarks.processes import Watched
from tests.benchmarks.start import environment, until
from tests.web.browser import CHROMIUM, open_browser

BREATH_S = 0.02
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
DONE = re.compile(r"^(\S+) INFO \S+ gcs_mosaic\.app\.live\.daemon: (.+): [\d.]+ s after it came; ")


@dataclass
class FlownLive:
    """Moments are seconds since 1970. `whole`: when each file was whole in the watched folder; `done`: when the last tile, and
    all that is told of a frame, was on the disk; `final_s`, `end_s`: from Ctrl-C to the final map with all that is told of it,
    and to the end of the program, which leaves open pages two seconds to read that."""

    out: Path
    whole: dict[str, float] = field(default_factory=dict)
    done: dict[str, float] = field(default_factory=dict)
    final_s: float = 0.0
    end_s: float = 0.0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    resident_mb: float = 0.0  # of all processes
    largest_mb: float = 0.0  # of the largest one

    @property
    def latencies(self) -> list[float]:
        """Seconds from a file being whole to its last tile, of each frame that was processed."""
        return [self.done[name] - whole for name, whole in self.whole.items() if name in self.done]

    @property
    def newest_late(self) -> list[float]:
        """For each frame, the seconds until it or a newer one was on the map."""
        soonest, late = np.inf, []
        for name, whole in reversed(self.whole.items()):
            soonest = min(soonest, self.done.get(name, np.inf))
            late.append(soonest - whole)
        return late[::-1]

    @property
    def seconds_a_frame(self) -> float:
        """Of work, from the first frame done to the last; only while frames wait all the time does it tell what one costs."""
        return (max(self.done.values()) - min(self.done.values())) / max(1, len(self.done) - 1)


def pictures_in(folder: Path, most: int | None = None) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in PICTURES)[:most]


def fly(
    pictures: list[Path], interval_s: float, home: Path, settings: str = "", *, page: bool = True, http: bool = True
) -> FlownLive:
    """Bring a picture each so many seconds, wait until all are processed, then Ctrl-C. `page`: it is open in a browser; `http`
    False: it is served where the settings say."""
    port = free_port()
    (home / "settings.yaml").write_text(settings)
    words = ["--mavlink", f"udp:127.0.0.1:{port}", "--config", "settings.yaml"]
    words += ["--http", "127.0.0.1:0"] if http else []
    flown = FlownLive(home / "mosaic")
    with ExitStack() as stack:
        said = stack.enter_context((home / "said").open("wb"))
        command = [sys.executable, "-m", "gcs_mosaic", *words]
        process = subprocess.Popen(command, cwd=home, stderr=said, env=environment())
        stack.callback(process.kill)
        vehicle = stack.enter_context(closing(Vehicle("127.0.0.1", port, ["camera"])))
        until(lambda: (home / "mosaic" / "mosaic.json").exists() and b"there" in said_in(home), process)
        if page:
            stack.enter_context(looking_on(page_of(home), home))
        watched, start = stack.enter_context(Watched(process.pid)), time.monotonic()
        bring(pictures, interval_s, vehicle, home / "frames", flown)
        until(lambda: all_done(flown, vehicle), process, most_s=1800.0)
        flown.wall_s, flown.cpu_s = time.monotonic() - start, watched.cpu_s
        flown.done = finished(flown)
        interrupted = time.time()
        flown.end_s = ended(process)
        flown.final_s = (flown.out / STATUS_NAME).stat().st_mtime - interrupted
        flown.resident_mb, flown.largest_mb = watched.resident_mb, watched.largest_mb
    return flown


def bring(pictures: list[Path], interval_s: float, vehicle: Vehicle, watch: Path, flown: FlownLive) -> None:
    """A trigger and then a whole file, one after another, telemetry all the while."""
    began = time.monotonic()
    for index, path in enumerate(pictures):
        while time.monotonic() < began + index * interval_s:
            vehicle.tick(None)
            time.sleep(BREATH_S)
        vehicle.capture(Capture(index=index + 1, name=path.name, state=None))
        (watch / "beside.part").write_bytes(path.read_bytes())
        (watch / "beside.part").rename(watch / path.name)
        flown.whole[path.name] = time.time()


def all_done(flown: FlownLive, vehicle: Vehicle) -> bool:
    """Whether all that was brought has been processed; meanwhile the vehicle goes on speaking."""
    vehicle.tick(None)
    time.sleep(BREATH_S)
    return len(finished(flown)) == len(flown.whole)


def finished(flown: FlownLive) -> dict[str, float]:
    """When each frame was processed, by name."""
    found = (DONE.match(line) for line in (flown.out / "flight.log").read_text().splitlines())
    return {line[2]: datetime.fromisoformat(line[1]).timestamp() for line in found if line}


def ended(process: subprocess.Popen[bytes]) -> float:
    """Seconds from Ctrl-C to the end."""
    start = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait(300)
    return time.monotonic() - start


@contextmanager
def looking_on(page: str, home: Path) -> Iterator[None]:
    """The page is open in a real browser, or without one in nothing."""
    if CHROMIUM is None:
        yield
        return
    with open_browser(home / "browser") as browser:
        browser.open(page)
        yield


def said_in(home: Path) -> bytes:
    return (home / "said").read_bytes()


def page_of(home: Path) -> str:
    found = re.search(rb"the map is at (\S+)", said_in(home))
    assert found, "the page is said"
    return found[1].decode()
