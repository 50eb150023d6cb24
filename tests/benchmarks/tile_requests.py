"""What many who look cost the stitching: python -m tests.benchmarks.tile_requests [FOLDER] [--pairs 3]

The real program stitches the frames of a folder, or of a simulated flight, as fast as it can, in turn alone and while 20 clients
ask for 200 tiles a second together; seconds of a frame, in pairs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from sitl.flight import plan
from sitl.path import Plan
from tests.benchmarks import flown_live
from tests.ports import free_port

SETTINGS = "web: {connections_per_address: 100}\n"


@contextmanager
def asking(port: int, flight: Path) -> Iterator[list[str]]:
    """Clients that ask for tiles of the map as it is, in a process of their own; what they tell at the end."""
    told = list[str]()
    command = [sys.executable, "-m", "tests.benchmarks.tile_clients", str(port), str(flight)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as clients:
        yield told
        told += clients.communicate("over\n")[0].splitlines()


def seconds_a_frame(pictures: list[Path], *, asked_for: bool) -> tuple[float, str]:
    """Of one flight, all frames brought at once."""
    port = free_port()
    with tempfile.TemporaryDirectory(prefix="tiles-") as folder:
        home = Path(folder)
        settings = f"{SETTINGS}http: 127.0.0.1:{port}\n"
        if not asked_for:
            return flown_live.fly(pictures, 0.0, home, settings, page=False, http=False).seconds_a_frame, ""
        with asking(port, home / "mosaic") as told:
            found = flown_live.fly(pictures, 0.0, home, settings, page=False, http=False).seconds_a_frame
        return found, " ".join(told)


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
            print(f"{alone:.3f} s a frame alone, {beside:.3f} s beside: {beside / alone:.2f}; {asked}", flush=True)
    print(f"median of the ratios {median(ratios):.2f}")


if __name__ == "__main__":
    main()
