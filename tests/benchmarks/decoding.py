"""What decoding in processes of their own costs, and what hostile pictures cost: `python -m tests.benchmarks.decoding [FRAMES]`.

A frame of 12 megapixels in a process and here; hostile pictures, each with a true frame behind it, as the first of a flight and
after frames of 12 megapixels; and FRAMES (1,000) frames, with processes killed among them: handles, memory, files left behind.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import struct
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.messages import content_hash
from tests.benchmarks.hostile import memory_mb
from tests.benchmarks.processes import Watched, family
from tests.frames.image_files import cut, encoded, many_scans, textured

TIMES = 15
KILL_EACH = 30  # frames
SIDE = 19_900  # px; just below the limit of 400 million pixels


def png_of_zeros(side: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(3 * side + 1)) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def jpeg_with_a_header_of(side: int, *options: int) -> bytes:
    data = bytearray(encoded(".jpg", textured(), *options))
    at = max(data.find(b"\xff\xc0"), data.find(b"\xff\xc2"))
    data[at + 5 : at + 9] = struct.pack(">HH", side, side)
    return bytes(data)


HOSTILE: dict[str, Callable[[], bytes]] = {
    "JPEG of 16 MP with 4,000 scans": lambda: many_scans(
        encoded(".jpg", np.full((3450, 4600, 3), 90, np.uint8), cv2.IMWRITE_JPEG_PROGRESSIVE, 1), 4000
    ),
    "PNG of 396 MP, all zeros": lambda: png_of_zeros(SIDE),
    "JPEG with 396 MP in its header": lambda: jpeg_with_a_header_of(SIDE),
    "progressive JPEG with 396 MP in its header": lambda: jpeg_with_a_header_of(SIDE, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "JPEG of 12 MP, cut in the middle and closed": lambda: cut(
        encoded(".jpg", cv2.resize(textured(), (4000, 3000))), 0.5
    ),
    "10 MB of restart markers before a JPEG": lambda: b"\xff\xd8" + b"\xff\xd0" * 5_000_000 + encoded(".jpg")[2:],
}


def true_frames() -> Iterator[bytes]:
    """Of 12 megapixels, about 2 MB each; no two are equal."""
    image = cv2.resize(textured(), (4000, 3000), interpolation=cv2.INTER_CUBIC)
    for number in range(10**6):
        image[:8, :8] = np.frombuffer(struct.pack("<Q", number) * 24, np.uint8).reshape(8, 8, 3)
        yield encoded(".jpg", image, cv2.IMWRITE_JPEG_QUALITY, 90)


def seconds(decoders: Decoders, data: bytes) -> tuple[float, str]:
    start = time.perf_counter()
    found = decoders.decode(data, content_hash(data))
    return time.perf_counter() - start, found.reason if isinstance(found, Unreadable) else "decoded"


def cost_of_a_process(frames: Iterator[bytes]) -> None:
    with closing(Decoders()) as decoders:
        seconds(decoders, next(frames))
        there, here = list[float](), list[float]()
        for _ in range(TIMES):
            data = next(frames)
            there.append(seconds(decoders, data)[0])
            start = time.perf_counter()
            decode_image(data)
            here.append(time.perf_counter() - start)
    of = f"a frame of 12 MP ({len(data) / 1e6:.1f} MB)"
    print(f"{of}: {1e3 * statistics.median(there):.0f} ms in a process, {1e3 * statistics.median(here):.0f} ms here")


def cost_of_hostile_ones(frames: Iterator[bytes]) -> None:
    for name, make in HOSTILE.items():
        data = make()
        for largest in (0, 12_000_000):
            with closing(Decoders(processes=1)) as decoders:
                decoders.note_true_frame(largest)
                seconds(decoders, next(frames))
                with Watched(os.getpid()) as watched:
                    taken_s, said = seconds(decoders, data)
                next_s, then = seconds(decoders, next(frames))
            when = "after frames of 12 MP" if largest else "as the first frame"
            memory = f"{watched.largest_mb / 1e3:.1f} GB at most in a process"
            print(f"{name} ({len(data) / 1e6:.1f} MB), {when}: {taken_s:.1f} s, {memory}, {said}", flush=True)
            print(f"    the frame behind it: {then} after {next_s:.2f} s more")


def constancy(frames: Iterator[bytes], count: int) -> None:
    dice, before = random.Random(1), shared_memory()
    with closing(Decoders()) as decoders:
        for number in range(count):
            _, said = seconds(decoders, next(frames))
            assert said == "decoded", said
            if number % KILL_EACH == KILL_EACH - 1:
                os.kill(dice.choice(decoding()), signal.SIGKILL)
            if number in (count // 10, count - 1):
                handles = len(list(Path("/proc/self/fd").iterdir()))
                print(
                    f"after {number + 1} frames: {handles} handles, {memory_mb():.0f} MB, {len(family(os.getpid()))} processes"
                )
    print(f"left: processes {decoding()}, files in shared memory {sorted(shared_memory() - before)}")


def decoding() -> list[int]:
    """The processes that decode."""
    children = family(os.getpid())[1:]
    return [one for one in children if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]


def shared_memory() -> set[str]:
    return {path.name for path in Path("/dev/shm").iterdir()}


def main(count: int = 1000) -> None:
    frames = true_frames()
    cost_of_a_process(frames)
    cost_of_hostile_ones(frames)
    constancy(frames, count)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
