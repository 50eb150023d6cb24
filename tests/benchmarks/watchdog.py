"""How long one turn of the main loop takes at most: python -m tests.benchmarks.watchdog DIR [--every 2]

The frames of a folder are flown into the live program, which tells a socket of this benchmark, as it would tell systemd, that its
main loop turns. The longest silence is what `WatchdogSec` in config/gcs-mosaic.service must allow.
"""

from __future__ import annotations

import argparse
import os
import shutil
import socket
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

from tests.running import flying, until

PATIENCE_S = 3600.0


@dataclass
class Silence:
    """The longest time without a sign, in flight and while it is being ended, in seconds."""

    longest: dict[str, float] = field(default_factory=lambda: {"in flight": 0.0, "at the end": 0.0})
    phase: str = "in flight"
    _last: float | None = None

    def listen(self, at: socket.socket) -> None:
        while b"the flight is over" not in (told := at.recv(4096)):
            if b"STOPPING=1" in told:
                self.phase = "at the end"
            if b"READY=1" in told or b"WATCHDOG=1" in told:
                now = time.monotonic()
                if self._last is not None:
                    self.longest[self.phase] = max(self.longest[self.phase], now - self._last)
                self._last = now


def longest_silence(pictures: list[Path], every_s: float, folder: Path) -> dict[str, float]:
    """Fly these pictures, one every so many seconds."""
    silence, address = Silence(), str(folder / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as at:
        at.bind(address)
        listener = threading.Thread(target=silence.listen, args=[at])
        listener.start()
        with (
            patch.dict(os.environ, {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "200000"}),
            flying(folder / "home", config="originals: {reserve_gb: 0}\nfinish_s: 600\n") as flight,
        ):
            for number, picture in enumerate(pictures):
                beside = flight.watch / f".{number}"
                shutil.copy(picture, beside)
                beside.rename(flight.watch / picture.name)
                time.sleep(every_s)
            until(lambda: flight.status()["frames"]["pending"] == 0, "all frames are looked at", PATIENCE_S)
            time.sleep(15.0)  # a pause, in which everything is adjusted
            flight.process.terminate()
            flight.process.wait(PATIENCE_S)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            end.sendto(b"the flight is over", address)
        listener.join()
    return silence.longest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("frames", type=Path)
    parser.add_argument("--every", type=float, default=2.0, metavar="S")
    parser.add_argument("--most", type=int, metavar="N", help="use the first N frames only")
    asked = parser.parse_args()
    pictures = sorted(path for path in asked.frames.rglob("*") if path.suffix.lower() in (".jpg", ".jpeg", ".png"))
    with tempfile.TemporaryDirectory(prefix="watchdog-") as folder:
        found = longest_silence(pictures[: asked.most], asked.every, Path(folder))
    print(
        f"{len(pictures[: asked.most])} frames: "
        + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in found.items())
    )


if __name__ == "__main__":
    main()
