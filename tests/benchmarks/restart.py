"""How long a start takes that goes on with a long flight, until the first new frame is on the map.

    python -m tests.benchmarks.restart FRAMES [--home DIR] [--runs 3]

Makes a flight of so many frames (of marks on the ground, see `long_growth`; kept in DIR for another time), cut off as by a kill,
and starts the daemon in its folder again while the next picture lies in the watched folder. Seconds on the wall clock from the
start of the process; the CPU seconds of all of it.
"""

from __future__ import annotations

import argparse
import json
import pickle
import shutil
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import cv2
from rich.console import Console

from gcs_mosaic.app.inputs.links import listen
from gcs_mosaic.app.live import daemon
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.app.pipeline import pipeline
from gcs_mosaic.app.pipeline.method import Method, method_of
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, thumbnail
from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.features.extraction import Features
from tests.benchmarks.flight_of_points import features_of_flight
from tests.benchmarks.long_growth import brought, ground
from tests.ports import free_port

MOST_S = 600.0
LOOK_S = 0.02
NEXT = "next.pickle"  # features of the next picture


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.restart")
    parser.add_argument("frames", type=int)
    parser.add_argument("--home", type=Path, help="folder for the flight, which is kept")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--started", type=float, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.started is not None:
        sys.exit(0 if go_on(given.home) else 1)
    with ExitStack() as stack:
        home = given.home or Path(stack.enter_context(TemporaryDirectory()))
        if not (home / "mosaic").exists():
            fly(given.frames, home)
        write_next_features(given.frames, home)
        told = [restarted(home, given.frames) for _ in range(given.runs)]
    print(
        f"{given.frames} frames: first new tile after {statistics.median(told):.1f} s ({min(told):.1f} to {max(told):.1f})"
    )


def settings(home: Path) -> Config:
    link = f"udp:127.0.0.1:{free_port()}"
    return Config(mavlink=(link,), http=None, watch=str(home / "frames"), out=str(home / "mosaic"), resume="always")


def fly(frames: int, home: Path) -> None:
    """A flight in `home` that has not ended; its next picture lies in the watched folder."""
    image, config = ground(), settings(home)
    for folder in (home / "mosaic", home / "frames"):
        folder.mkdir(parents=True)
    picture = cv2.imencode(".jpg", image)[1].tobytes()
    checkpoints, out = checkpoints_of(home / "mosaic", config), home / "mosaic"
    with closing(Pipeline(out, config, lambda notice: None, checkpoints=checkpoints)) as flight:
        for number, features in enumerate(features_of_flight(frames)):
            frame = flight.accept(brought(number, picture, home / "frames"))
            assert frame is not None, "no two files are the same"
            flight.process(DecodedFrame(frame, image, features, thumbnail(image), {}))
            flight.save()
            if number % 100 == 99:
                print(f"{number + 1} frames flown", file=sys.stderr, flush=True)
        flight.checkpoint(at_once=True)
    brought(frames, picture, home / "frames")


def write_next_features(frames: int, home: Path) -> None:
    """What the next picture shows; the ground is walked over from the start, which is not the daemon's to wait for."""
    features = next(islice(features_of_flight(frames + 1), frames, None))
    (home / NEXT).write_bytes(pickle.dumps(features))


def restarted(home: Path, frames: int) -> float:
    """Seconds from the start of a process, in a copy of the flight, to the new frame's place on the map."""
    with TemporaryDirectory(dir=home) as scratch:
        again = Path(scratch)
        shutil.copytree(home / "mosaic", again / "mosaic", symlinks=True)
        shutil.copytree(home / "frames", again / "frames")
        shutil.copy(home / NEXT, again)
        words = ["-m", "tests.benchmarks.restart", str(frames), "--home", str(again), "--started", "0"]
        began = time.monotonic()
        child = subprocess.Popen([sys.executable, *words])
        try:
            return next(placed_after(again, began, frames, child))
        finally:
            child.kill()
            child.wait()


def placed_after(home: Path, began: float, frames: int, child: subprocess.Popen[bytes]) -> Iterator[float]:
    """Seconds until each change of the map with the new frame on it."""
    while time.monotonic() - began < MOST_S:
        if child.poll() is not None:
            raise RuntimeError("the daemon has ended")
        status = json.loads((home / "mosaic" / "status.json").read_bytes()) if started(home) else {}
        last = status.get("last_frame") or {}
        if last.get("name") == f"IMG_{frames:05}.JPG" and last["outcome"] == "placed":
            yield time.monotonic() - began
        time.sleep(LOOK_S)
    raise RuntimeError("the new frame is not on the map")


def started(home: Path) -> bool:
    return (home / "mosaic" / "status.json").exists()


def go_on(home: Path) -> bool:
    """The daemon, for which the next picture has the features that its place in the flight gives it."""
    features: Features = pickle.loads((home / NEXT).read_bytes())

    def method(*parts: object, **more: object) -> Method:
        def found(image: object, *, reduction: int) -> Features:
            return features

        return method_of(*parts, **more)._replace(features_of=found)  # type: ignore[arg-type]

    stop = threading.Event()
    with ExitStack() as stack:
        stack.enter_context(patch.object(pipeline, "method_of", method))
        config = settings(home)
        links = listen(config, stop, stack)
        daemon.fly(config, links, Console(stderr=True), Shutdown(stop=stop, hurry=threading.Event()))
    return True


if __name__ == "__main__":
    main()
