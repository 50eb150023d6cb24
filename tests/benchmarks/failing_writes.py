"""Let every single write of a flight fail once: python -m tests.benchmarks.failing_writes (Linux, with a C compiler)

A small library is loaded before the C library; it counts the calls that change the output folder (open, write, sync, rename,
make, remove, truncate, of Python and of SQLite alike), and lets the n-th fail: once, or it and all others for a moment. The
same small flight is flown for every n. Each time all frames must be placed, everything on the disk agree, and the operator
have been told in a few sentences.
"""

from __future__ import annotations

import argparse
import ctypes
import errno
import io
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

Found = dict[str, Any]  # what a flight came to

LIBRARY = "FAILING_WRITES"
FRAMES = 4
LONGEST_S = 90
SECONDS = 0.3  # that a lasting failure lasts
TROUBLE = ("cannot be", "could not", "written again", "is full", "is slow", "anew", "not kept")
SENTENCES = 6  # at most: it fails, it goes on, and so for the log and the recording


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--errors", default="ENOSPC,EIO,EROFS,ENOENT")
    parser.add_argument("--each", type=int, default=1, help="only every so many calls")
    parser.add_argument("--lasting", action="store_true", help=f"all calls fail for {SECONDS} s")
    parser.add_argument("--only", type=int, help="this call alone, and tell more")
    parser.add_argument("--slow", type=int, default=0, help="milliseconds that each call takes longer; none fails")
    asked = parser.parse_args()
    if LIBRARY not in os.environ:
        return with_library()
    with tempfile.TemporaryDirectory(prefix="failing-writes-") as scratch:
        return Trials(Path(scratch), asked).all()


def with_library() -> int:
    """Run again with the library loaded."""
    with tempfile.TemporaryDirectory(prefix="failing-writes-") as folder:
        library = Path(folder) / "failing_writes.so"
        source = Path(__file__).with_suffix(".c")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-w", "-o", library, source, "-ldl"], check=True)
        environment = os.environ | {"LD_PRELOAD": str(library), LIBRARY: str(library), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "tests.benchmarks.failing_writes", *sys.argv[1:]]
        return subprocess.run(command, env=environment, check=False).returncode


class Trials:
    """Flies again and again, each time in a process of its own that begins with everything loaded."""

    def __init__(self, scratch: Path, asked: argparse.Namespace) -> None:
        from gcs_mosaic.app.live import daemon  # noqa: F401 -- loaded before the processes part
        from sitl.flight import plan
        from sitl.path import Plan

        self.scratch, self.asked = scratch, asked
        self.watched = scratch / "frames"
        self.watched.mkdir()
        route = Plan(frames=FRAMES)
        pictures = plan("survey", (480, 360), seed=3, world_size=1024, route=route).pictures()
        self.count = 0
        for number, picture in enumerate(pictures):
            (self.watched / f"IMG_{number:03}.JPG").write_bytes(picture)
            self.count += 1

    def all(self) -> int:
        kinds = [kind for kind in self.asked.errors.split(",") if kind]
        calls = self.fly(None, 0)
        if self.asked.slow:
            print(f"{self.count} frames, {calls['calls']} calls, each {self.asked.slow} ms slower: {calls}")
            return int("trouble" in calls)
        print(f"{self.count} frames, {calls['calls']} calls that change the folder; told: {calls['told']}", flush=True)
        if "trouble" in calls:
            print(calls["trouble"])
            return 1
        told, failed = Counter[str](), 0
        numbers = range(0, calls["calls"], self.asked.each) if self.asked.only is None else [self.asked.only]
        for kind in kinds:
            for number in numbers:
                found = self.fly(number, getattr(errno, kind))
                told[f"{len(found.get('told', []))} sentences"] += 1
                if "trouble" in found or self.asked.only is not None:
                    failed += "trouble" in found
                    print(
                        f"{kind} at {number}, {found.get('met')}: {found.get('trouble')}\n    {found.get('told')}",
                        flush=True,
                    )
        print(f"{failed} of {len(kinds) * len(numbers)} flights were not whole; told: {dict(sorted(told.items()))}")
        return 1 if failed else 0

    def fly(self, number: int | None, error: int) -> Found:
        """Fly in a process of its own; what it found."""
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            try:
                found = OneFlight(self, number, error).flown()
            except BaseException:
                found = {"trouble": traceback.format_exc()}
            os.write(writing, json.dumps(found)[:60000].encode())
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as file:
            told = file.read()
        os.waitpid(child, 0)
        return dict(json.loads(told or b'{"trouble": "died"}'))


class OneFlight:
    """One flight, during which the call of this number fails."""

    def __init__(self, trials: Trials, number: int | None, error: int) -> None:
        self.trials, self.number, self.error = trials, number, error
        self.library = ctypes.CDLL(os.environ[LIBRARY])
        self.library.what_failed.restype = ctypes.c_char_p
        self.library.counted.restype = ctypes.c_long

    def flown(self) -> Found:
        with tempfile.TemporaryDirectory(prefix="flight-", dir=self.trials.scratch) as folder:
            out = Path(folder) / "mosaic"
            threading.Timer(LONGEST_S, lambda: os._exit(3)).start()
            said, seconds = self.fly(out)
            met = self.library.what_failed().decode()
            self.library.arm(b"", -1, 0, ctypes.c_double(0), 0, 0)
            found = {"calls": self.calls, "met": met, "seconds": round(seconds, 1)}
            found["told"] = [
                line
                for line in said
                if "cannot" in line or "could not" in line or "again" in line or "full" in line or "slow" in line
            ]
            trouble = judged(out, Path(folder), self.trials.count)
            if len(found["told"]) > SENTENCES:
                trouble.append(f"{len(found['told'])} sentences")
            return found | ({"trouble": trouble} if trouble else {})

    def fly(self, out: Path) -> tuple[list[str], float]:
        from rich.console import Console

        from gcs_mosaic.app.inputs import links as listening
        from gcs_mosaic.app.live import daemon as live
        from gcs_mosaic.app.live.shutdown import Shutdown
        from gcs_mosaic.config.tree import Config
        from tests.ports import free_port

        config = Config(
            mavlink=(f"udp:127.0.0.1:{free_port()}",),
            http=None,
            watch=str(self.trials.watched),
            out=str(out),
            record=True,
        )
        config = replace(
            config, frames=replace(config.frames, from_age_s=1e9), originals=replace(config.originals, reserve_gb=0.0)
        )
        shutdown = Shutdown(stop=threading.Event(), hurry=threading.Event())
        self.arrange(live, out, shutdown)
        live.RETRY_S = 0.05
        told, start = io.StringIO(), time.monotonic()
        with ExitStack() as stack:
            links = listening.listen(config, shutdown.stop, stack)
            live.fly(config, links, Console(file=told, width=2000), shutdown)
        return told.getvalue().splitlines(), time.monotonic() - start

    def arrange(self, live: Any, out: Path, shutdown: Any) -> None:
        """Count from when the flight has begun until it has ended, and end it when all frames are done."""
        daemon, done = live._Daemon, set[str]()
        run, note = daemon.run, daemon._note_done

        def counting(flight: Any, inputs: Any) -> None:
            at = -1 if self.number is None else self.number
            lasting = SECONDS if self.trials.asked.lasting else 0.0
            self.library.arm(str(out).encode(), at, 1, ctypes.c_double(lasting), self.error, self.trials.asked.slow)
            run(flight, inputs)
            self.calls = self.library.counted()

        def noting(flight: Any, one: Any) -> None:
            note(flight, one)
            done.add(one.name)
            if len(done) == self.trials.count:
                shutdown.stop.set()

        daemon.run, daemon._note_done = counting, noting


def judged(out: Path, folder: Path, count: int) -> list[str]:
    """What is not as it should be."""
    from gcs_mosaic.app.pipeline.resuming import LARGE
    from gcs_mosaic.store.checkpoint import Checkpoints, Unusable
    from gcs_mosaic.store.ledger import Ledger
    from gcs_mosaic.store.originals import is_intact
    from tests.documents import placements
    from tests.rebuilt import assert_explained

    trouble = []
    with Ledger(out / "flight.sqlite", read_only=True) as ledger:
        if ledger.rows("PRAGMA integrity_check")[0][0] != "ok":
            trouble.append("the ledger is damaged")
        frames = ledger.frames()
    trouble += [f"{frame.name} is {frame.state} ({frame.reason})" for frame in frames if frame.state != "placed"]
    trouble += [
        f"{frame.name} has no original"
        for frame in frames
        if not is_intact(out / str(frame.original), str(frame.content_hash))
    ]
    if len(frames) != count:
        trouble.append(f"{len(frames)} frames")
    told = json.loads((out / "mosaic.json").read_bytes())
    if told["frames"]["placed"] != count or len(placements(out)["frames"]) != count:
        trouble.append("the documents tell of other frames")
    if json.loads((out / "status.json").read_bytes())["state"] != "stopped":
        trouble.append("status.json is old")
    checkpoints = Checkpoints(out, LARGE)
    if isinstance(state := checkpoints.load(), Unusable):
        trouble.append(state.reason)
    checkpoints.close()
    trouble += [f"{path.name} is left" for path in out.rglob("*.part")]
    try:
        assert_explained(out, folder / "rebuilt")
    except AssertionError as error:
        trouble.append(f"tiles are not what the ledger says: {str(error)[:300]}")
    return trouble


if __name__ == "__main__":
    sys.exit(main())
