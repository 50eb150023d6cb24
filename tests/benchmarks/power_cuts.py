"""Cut the power of a flight's disk: python -m tests.benchmarks.power_cuts --cuts 100 (as root, on Linux)

A disk in a file is copied while a flight is written to it: the copy has what had reached the disk, and nothing else. It is
mounted as after a power cut, and looked at: is every original there that the ledger names, is anything missing that is older
than a second, does a document tell of what the ledger does not know?
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.check.snapshot import integrity_problem
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import is_intact
from sitl.flight import plan
from sitl.path import Plan
from tests.running import Running, flying

SIZE_MB = 256
FRAMES, EACH_S = 40, 0.4
BEHIND_S = 1.0  # what is older at the cut must not be missing
SETTINGS = "originals: {reserve_gb: 0}\nfinish_s: 30\n"


@dataclass(frozen=True, slots=True)
class Cut:
    """What is found on the disk after the power was cut. Numbers of frames, or of files."""

    frames: int  # in the ledger
    placed: int  # by the ledger
    broken: int  # frames in the ledger whose original is not what came
    missing: int  # frames that the ledger has lost though they were in it more than `BEHIND_S` before
    ahead: int  # more frames in mosaic.json than in the ledger
    resumable: bool  # there is a whole checkpoint, or nothing was placed yet
    malformed: str = ""  # what is wrong with the ledger's file

    @property
    def harmless(self) -> bool:
        return not (self.broken or self.missing or self.ahead or self.malformed) and self.resumable


def cuts(count: int, kind: str = "ext4", seed: int = 0, each_s: float = EACH_S) -> Iterator[Cut]:
    """Fly as often as it takes, and cut the power so many times, at random moments."""
    chance = random.Random(seed)
    pictures = list(plan("survey", (640, 480), seed=3, world_size=2048, route=Plan(frames=FRAMES)).pictures())
    done = 0
    while done < count:
        with tempfile.TemporaryDirectory(prefix="power-cuts-") as scratch:
            for cut in flown(Path(scratch), kind, pictures, chance, each_s):
                yield cut
                done += 1
                if done == count:
                    return


def flown(
    scratch: Path, kind: str, pictures: list[bytes], chance: random.Random, each_s: float = EACH_S
) -> Iterator[Cut]:
    """One flight, cut about five times."""
    image, place = scratch / "disk.img", scratch / "disk"
    make_disk(image, kind)
    with mounted(image, place), flying(scratch / "home", out=place / "mosaic", config=SETTINGS) as flight:
        seen: dict[str, float] = {}
        for number, picture in enumerate(pictures):
            flight.take(f"IMG_{number:03}.JPG", picture)
            until = time.monotonic() + each_s
            while time.monotonic() < until:
                note_frames(flight, seen)
                time.sleep(0.02)
            if number and chance.random() < 0.15:
                yield look(image, scratch, seen, flight)
        flight.process.kill()
        flight.process.wait()


def note_frames(flight: Running, seen: dict[str, float]) -> None:
    """When each frame was first seen in the ledger."""
    with suppress(Exception), Ledger(flight.out / LEDGER_NAME, read_only=True) as ledger:
        for frame in ledger.frames():
            seen.setdefault(frame.name, time.monotonic())


def look(image: Path, scratch: Path, seen: dict[str, float], flight: Running) -> Cut:
    """Cut the power now, and start again. Meanwhile the program stands still: a copy of a disk that is being written to has its
    beginning of one moment and its end of another, as no disk has after a power cut."""
    copy, place = scratch / "cut.img", scratch / "cut"
    stopped = time.monotonic()
    flight.process.send_signal(signal.SIGSTOP)
    try:
        old = {name for name, at in seen.items() if at < stopped - BEHIND_S}
        subprocess.run(["cp", "--sparse=always", image, copy], check=True)
        with mounted(copy, place):
            return found(place / "mosaic", old)
    finally:
        flight.process.send_signal(signal.SIGCONT)
        for name in seen:
            seen[name] += time.monotonic() - stopped


def found(out: Path, old: set[str]) -> Cut:
    try:
        with Ledger(out / LEDGER_NAME) as ledger:
            frames, accounts = ledger.frames(), ledger.accounts().frames
            malformed = integrity_problem(ledger) or ""
    except (UsageError, sqlite3.Error) as error:
        return Cut(0, 0, 0, len(old), 0, resumable=False, malformed=str(error))
    kept = [frame for frame in frames if frame.original and frame.content_hash]
    told = json.loads((out / "mosaic.json").read_bytes() or b"{}") if (out / "mosaic.json").exists() else {}
    return Cut(
        frames=len(frames),
        placed=accounts.placed,
        broken=sum(not is_intact(out / str(frame.original), str(frame.content_hash)) for frame in kept),
        missing=len(old - {frame.name for frame in frames}),
        ahead=max(0, told.get("frames", {}).get("placed", 0) - accounts.placed),
        resumable=(out / "checkpoint").exists() or accounts.placed < 3,
        malformed=malformed,
    )


def make_disk(image: Path, kind: str) -> None:
    subprocess.run(["truncate", "-s", f"{SIZE_MB}M", image], check=True)
    quiet = ["-q"] if kind == "ext4" else []
    subprocess.run([f"mkfs.{kind}", *quiet, image], check=True, stdout=subprocess.DEVNULL)


@contextmanager
def mounted(image: Path, place: Path) -> Iterator[None]:
    place.mkdir(exist_ok=True)
    subprocess.run(["mount", "-o", "loop", image, place], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", place], check=True)


def cannot(kind: str = "ext4") -> str:
    """Why this machine has no disks of this kind to cut; empty if it has."""
    if shutil.which(f"mkfs.{kind}") is None:
        return f"mkfs.{kind} is not installed"
    with tempfile.TemporaryDirectory(prefix="power-cuts-") as scratch:
        image = Path(scratch) / "disk.img"
        make_disk(image, kind)
        place = Path(scratch) / "disk"
        place.mkdir()
        tried = subprocess.run(["mount", "-o", "loop", image, place], capture_output=True, text=True, check=False)
        if tried.returncode:
            return f"a disk in a file cannot be mounted here ({tried.stderr.strip()})"
        subprocess.run(["umount", place], check=True)
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--disk", choices=["ext4", "vfat", "exfat"], default="ext4")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", type=float, default=EACH_S, metavar="S", help="seconds between pictures")
    asked = parser.parse_args()
    harm = 0
    for number, cut in enumerate(cuts(asked.cuts, asked.disk, asked.seed, asked.each), 1):
        harm += not cut.harmless
        print(f"{number:4} {cut}", flush=True)
    print(f"{harm} of {asked.cuts} cuts did harm")
    return 1 if harm else 0


if __name__ == "__main__":
    sys.exit(main())
