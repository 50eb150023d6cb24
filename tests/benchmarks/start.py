"""How soon the program hears a link after its start, and how soon its first frame is on the map.

    python -m tests.benchmarks.start [PICTURE] [--runs 5]

Seconds on the wall clock, medians of fresh processes, and the CPU seconds of one until it listens; the packages that it
is built on, imported alone, are the floor. *listens*: the UDP port is bound, so whatever comes is kept. *page*: it says where
the map is. *ready*: an empty map is written, so frames are processed. *tile*: from a first picture of 12 MP being whole in the
watched folder, once it is ready, to the first tile being on the disk. Linux only, as it reads /proc.
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from tests.benchmarks.processes import cpu_of

MOST_S = 60.0
LOOK_S = 0.005
PACKAGES = "import numpy, cv2, scipy.sparse.linalg, scipy.spatial, scipy.ndimage, yaml, rich.console, tifffile, sqlite3"
STAGES = ("listens", "page", "ready", "tile", "CPU s until it listens")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.start")
    parser.add_argument("picture", nargs="?", type=Path, help="a JPEG file instead of a made-up one of 12 MP")
    parser.add_argument("--runs", type=int, default=5)
    given = parser.parse_args()
    picture = given.picture.read_bytes() if given.picture else made_up()
    runs = [started(picture) for _ in range(given.runs)]
    for stage, seconds in zip(STAGES, zip(*runs, strict=True), strict=True):
        print(f"{stage:>24}{statistics.median(seconds):8.2f}   {min(seconds):.2f} to {max(seconds):.2f}")
    floor = [timed(lambda: subprocess.run([sys.executable, "-c", PACKAGES], check=True)) for _ in runs]
    print(f"{'the packages alone':>24}{statistics.median(floor):8.2f}   {min(floor):.2f} to {max(floor):.2f}")


def made_up() -> bytes:
    """A JPEG file of 4000x3000 pixels with something to see at every size."""
    rng, picture = np.random.default_rng(1), np.zeros((3000, 4000, 3), np.float32)
    for coarse in (1, 4, 16, 64, 256):
        noise = rng.normal(0, 12, (-(-3000 // coarse), -(-4000 // coarse), 3)).astype(np.float32)
        picture += cv2.resize(noise, (4000, 3000), interpolation=cv2.INTER_CUBIC)
    return cv2.imencode(".jpg", np.clip(picture + 128, 0, 255).astype(np.uint8))[1].tobytes()


def started(picture: bytes) -> tuple[float, ...]:
    """Seconds for each of STAGES, of one process."""
    with TemporaryDirectory() as scratch, (Path(scratch) / "said").open("wb") as said:
        home, port = Path(scratch), free_port()
        words = ["--mavlink", f"udp:127.0.0.1:{port}", "--http", "127.0.0.1:0"]
        start = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "gcs_mosaic", *words], cwd=home, stderr=said, env=environment()
        )
        try:
            listens = until(lambda: is_bound(port), process) - start
            cpu = cpu_of(process.pid)
            page = until(lambda: b"the map is at" in (home / "said").read_bytes(), process) - start
            ready = until(lambda: (home / "mosaic" / "mosaic.json").exists(), process) - start
            whole = bring(picture, home)
            tile = until(lambda: any((home / "mosaic" / "tiles").rglob("*.jpg")), process) - whole
        finally:
            process.kill()
            process.wait()
    return listens, page, ready, tile, cpu


def bring(picture: bytes, home: Path) -> float:
    """The picture appears in the watched folder; returns when."""
    (home / "beside.part").write_bytes(picture)
    (home / "beside.part").rename(home / "frames" / "IMG_0001.JPG")
    return time.monotonic()


def environment() -> dict[str, str]:
    """Ours, with this very checkout before any that is installed."""
    return os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}


def until(holds: Callable[[], bool], process: subprocess.Popen[bytes], most_s: float = MOST_S) -> float:
    """When it first holds, on the monotonic clock."""
    end = time.monotonic() + most_s
    while not holds():
        if process.poll() is not None or time.monotonic() > end:
            raise SystemExit("the program did not get so far")
        time.sleep(LOOK_S)
    return time.monotonic()


def is_bound(port: int) -> bool:
    """Whether a UDP socket of this machine has this port."""
    return f":{port:04X} " in Path("/proc/net/udp").read_text()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def timed(work: Callable[[], object]) -> float:
    start = time.monotonic()
    work()
    return time.monotonic() - start


if __name__ == "__main__":
    main()
