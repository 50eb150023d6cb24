"""The program as an operator has it: a process with a link, a watched folder, an output folder and a terminal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameRecord
from sitl.flight import Flight, plan
from sitl.messages import Capture
from sitl.path import Plan
from sitl.vehicle import Vehicle
from tests.documents import document_at
from tests.ports import free_port

LONGEST_WAIT_S = 120.0  # for anything at all on a busy machine
POLL_S = 0.05
PROGRAM = (sys.executable, "-m", "gcs_mosaic")
FEW_FEATURES = "stitch: {features: {count: 500}}\n"  # as in tests/settings.py
QUICK = f"frames: {{damaged_after_s: 0.7, recheck_longest_s: 0.3}}\nfinish_s: 30\n{FEW_FEATURES}"


def run(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The program with these words, to its end."""
    command = [*PROGRAM, *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=LONGEST_WAIT_S, check=False
    )


def stitched(flight: Flight, home: Path) -> Path:
    """The folder of a simulated flight's pictures, stitched; it is in `home`, and so are they."""
    (home / "pictures").mkdir()
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        (home / "pictures" / Path(name).name).write_bytes(data)
    done = run("stitch", "pictures", "--out", "mosaic", cwd=home)
    assert done.returncode == 0, done.stderr
    return home / "mosaic"


def until(true: Callable[[], Any], what: str, patience_s: float = LONGEST_WAIT_S) -> Any:
    """Wait until something is so and return it; the test fails if it does not become so."""
    deadline = time.monotonic() + patience_s
    while not (found := true()):
        assert time.monotonic() < deadline, f"still not so: {what}"
        time.sleep(POLL_S)
    return found


@dataclass
class Running:
    """A live flight in `home`: pictures go to home/frames, the map to `out`, what is said to home/said.txt."""

    process: subprocess.Popen[bytes]
    home: Path
    out: Path
    vehicle: Vehicle
    silent: bool = False  # its terminal is elsewhere
    taken: int = 0

    @property
    def watch(self) -> Path:
        return self.home / "frames"

    @property
    def said(self) -> str:
        return (self.home / "said.txt").read_text()

    def document(self, name: str) -> dict[str, Any]:
        return document_at(self.out / name)

    def status(self) -> dict[str, Any]:
        return self.document("status.json")

    def trigger(self, name: str) -> None:
        """The camera says that it took a picture, which will be in the file `name`."""
        self.taken += 1
        self.vehicle.tick(None)
        self.vehicle.capture(Capture(index=self.taken, name=name, state=None))

    def take(self, name: str, data: bytes) -> None:
        """A picture is triggered, and its file is there."""
        self.trigger(name)
        self.bring(name, data)

    def bring(self, name: str, data: bytes) -> None:
        """A file appears in the watched folder, whole."""
        path = self.watch / name
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f"{path.name}.part")
        beside.write_bytes(data)
        beside.rename(path)

    def wait_for(self, true: Callable[[dict[str, Any]], object], what: str) -> dict[str, Any]:
        """Wait until status.json says so; returns it."""

        def holds() -> bool:
            assert self.process.poll() is None, self.said
            return (self.out / "status.json").exists() and bool(true(self.status()))

        until(holds, f"{what}; it said: {self.said}" if self.process.poll() else what)
        return self.status()

    def wait_for_frames(self, **states: int) -> None:
        """Wait until the account of the frames has these numbers."""
        self.wait_for(lambda status: states.items() <= status["frames"].items(), f"frames {states}")

    def end(self, sign: signal.Signals = signal.SIGTERM) -> int:
        """Ask for the end; returns the exit code."""
        self.process.send_signal(sign)
        return self.process.wait(LONGEST_WAIT_S)


def six_pictures(cache: Path, *, seed: int = 3, size: tuple[int, int] = (640, 480)) -> list[bytes]:
    """JPEG files of six pictures that overlap; another seed is another ground."""
    route = Plan(frames=6, height=60)
    return list(plan("survey", size, cache=cache, seed=seed, world_size=2048, route=route).pictures())[:6]


@contextmanager
def flying(
    home: Path, *options: str, out: Path | None = None, config: str | None = QUICK, terminal: int | None = None
) -> Iterator[Running]:
    """The live program, started and listening; killed in the end if it still runs. `terminal` takes what it says."""
    port = free_port()
    home.mkdir(parents=True, exist_ok=True)
    words = ["--mavlink", f"udp:127.0.0.1:{port}", *([] if "--http" in options else ["--no-http"]), *options]
    words += [] if out is None else ["--out", str(out)]
    if config is not None:
        (home / "config.yaml").write_text(config)
        words += ["--config", "config.yaml"]
    environment = os.environ | {"PYTHONPATH": os.environ.get("PYTHONPATH") or str(Path(__file__).parents[1])}
    with (home / "said.txt").open("wb") as said, closing(Vehicle("127.0.0.1", port, ["camera"])) as vehicle:
        process = subprocess.Popen([*PROGRAM, *words], cwd=home, env=environment, stderr=terminal or said)
        flight = Running(process, home, out or home / "mosaic", vehicle, silent=terminal is not None)
        try:
            until(lambda: has_started(flight), "started")
            yield flight
        finally:
            process.kill()
            process.wait()


def has_started(flight: Running) -> bool:
    assert flight.process.poll() is None, flight.said
    if flight.silent:
        return (flight.out / "status.json").exists()
    return "frames were there" in flight.said or "1 frame was there" in flight.said or "frames come from" in flight.said


def frames_of(out: Path) -> dict[str, FrameRecord]:
    """What the ledger says of every frame, by name."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return {frame.name: frame for frame in ledger.frames()}


def events_of(out: Path) -> list[str]:
    """The state of every event, in their order."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return [str(record.state) for record in ledger.events()]
