"""How the memory of a live flight grows: python -m tests.benchmarks.memory [FRAMES] [--megapixels 3] [--features 2000]

A flight of marks on the ground (`long_growth`) is placed, painted and written, with checkpoints; all frames show one picture. The
marks are made in a process of their own. The most anonymous memory (MB) of the process that stitches after any of the last
frames, the size of the C library's heap, and what is in use of that. At the end the growth per frame over the last three
quarters.
"""

from __future__ import annotations

import argparse
import ctypes
import multiprocessing
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from gcs_mosaic.app.machine import share_heap
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, thumbnail
from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.features.extraction import Features
from sitl.path import fly
from tests.benchmarks.flight_of_points import LENS, features_of_states, plan
from tests.benchmarks.long_growth import REPAINTS, brought, ground

EACH = 100  # frames between two lines


class HeapInfo(ctypes.Structure):
    """glibc's mallinfo2."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in [
            "arena",
            "ordblks",
            "smblks",
            "hblks",
            "hblkhd",
            "usmblks",
            "fsmblks",
            "uordblks",
            "fordblks",
            "keepcost",
        ]
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.memory")
    parser.add_argument("frames", nargs="?", type=int, default=2000)
    parser.add_argument("--megapixels", type=float, default=3.0, help="of a frame")
    parser.add_argument("--features", type=int, default=2000, help="of a frame")
    given = parser.parse_args()
    share_heap()
    told: list[tuple[int, float]] = []
    print(f"{'frames':>8}{'anonymous':>11}{'heap':>8}{'in use':>8}{'s':>7}", flush=True)
    began, most = time.monotonic(), 0.0
    with TemporaryDirectory(prefix="memory-") as folder:
        for number in flown(given.frames, given.megapixels, given.features, Path(folder)):
            most = max(most, anonymous_mb())
            if number % EACH == 0 or number == given.frames:
                told.append((number, most))
                heap = heap_info()
                columns = (
                    f"{most:11.0f}{(heap.arena + heap.hblkhd) / 2**20:8.0f}{(heap.uordblks + heap.hblkhd) / 2**20:8.0f}"
                )
                print(f"{number:8}{columns}{time.monotonic() - began:7.0f}", flush=True)
                most = 0.0
    (early, first), (late, last) = told[len(told) // 4], told[-1]
    if late > early:
        print(f"{(last - first) / (late - early):.2f} MB a frame from frame {early} to {late}")


def flown(frames: int, megapixels: float, features: int, home: Path) -> Iterator[int]:
    """The number of frames so far, after each one."""
    factor = (megapixels * 1e6 / (LENS.width * LENS.height)) ** 0.5
    size = round(LENS.width * factor), round(LENS.height * factor)
    image = cv2.resize(ground(), size, interpolation=cv2.INTER_CUBIC)
    picture, out = cv2.imencode(".jpg", image)[1].tobytes(), home / "mosaic"
    out.mkdir()
    checkpoints = checkpoints_of(out, Config())
    with closing(Pipeline(out, Config(), lambda notice: print(notice.text), checkpoints=checkpoints)) as pipeline:
        driver = Driver(pipeline)
        for number, one in enumerate(features_made_apart(frames, features), start=1):
            frame = pipeline.accept(brought(number, picture, home))
            assert frame is not None, "no two files are the same"
            seen = replace(
                one, kept_points=one.points * factor, width=size[0], height=size[1], scale=one.scale * factor
            )
            driver.process(DecodedFrame(frame, image, seen, thumbnail(image), {}))
            pipeline.checkpoint()
            for _ in range(REPAINTS):
                if pipeline.has_repaints and pipeline.repaint_some():
                    pipeline.save()
            yield number


def features_made_apart(frames: int, count: int) -> Iterator[Features]:
    """The features of each frame, made in a process of their own, whose memory is not ours."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    maker = spawn.Process(target=make_features, args=(theirs, frames, count), daemon=True)
    maker.start()
    for _ in range(frames):
        ours.send(None)
        yield ours.recv()
    maker.join()


def make_features(asked: Connection, frames: int, count: int) -> None:
    for features in features_of_states(fly("survey", LENS, plan(frames)), seen=count):
        asked.recv()
        asked.send(features)


def anonymous_mb() -> float:
    """Memory that is backed by no file."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1024


def heap_info() -> HeapInfo:
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = HeapInfo
    info: HeapInfo = ask()
    return info


if __name__ == "__main__":
    main()
