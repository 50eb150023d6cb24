"""What it costs to write a frame down, early in a long flight and late: ledger and documents, without tiles.

    python -m tests.benchmarks.writing [FRAMES]

CPU milliseconds a frame, so that a machine that does other things as well may be used. The flight is made up: one island, one
frame each two seconds, one trigger for each, and all frames lie elsewhere whenever the island has grown by 7 %, as
adjustments have it. A late frame may cost 1.15 times as much as an early one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import cast
from unittest.mock import patch

import numpy as np

from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.render_list import Extent, RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.store import placements
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.records import EventState, FrameState, IslandRecord
from tests.factories import frame, trigger_event

FRAMES = 3000
EARLY, WINDOW = (50, 150), 100  # frames over which is averaged; of the late ones the last so many
STRETCHES = (1000, 2000, 3000)  # ends of windows
EACH_S = 2.0  # between frames, on the clock that tells when placements.json is due
GROWTH = 1.07
CANVAS = cast(TileCompositor, SimpleNamespace(tile=lambda *_: None, extent=lambda _: Extent((0, 0, 1, 1), 10, 16)))
RELIEF = ReliefDisplacement(17, 13, bytes(17 * 13 * 2 * 4))


def main() -> None:
    report(int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES)


def report(count: int) -> None:
    """Print what frames of a flight of so many cost."""
    costs = np.array(list(costs_of_flight(count)))
    windows = [EARLY, *((end - WINDOW, end) for end in STRETCHES if end <= count)]
    print(f"CPU ms a frame\n{'frames':>15}{'median':>9}{'mean':>9}{'longest':>9}{'ratio':>8}  bytes written, mean")
    for first, last in windows:
        ms, size = 1e3 * costs[first:last, 0], costs[first:last, 1].mean()
        ratio = np.median(ms) / np.median(1e3 * costs[slice(*EARLY), 0])
        print(f"{f'{first} - {last}':>15}{np.median(ms):9.2f}{ms.mean():9.2f}{ms.max():9.2f}{ratio:8.2f}  {size:,.0f}")


def costs_of_flight(count: int) -> Iterator[tuple[float, int]]:
    """CPU seconds and bytes of documents for each frame in turn."""
    camera, moved_at = Camera(4000, 3000, 1.4), 1.0
    with TemporaryDirectory() as scratch, closing(FlightStore(Path(scratch))) as store, hurried() as clock:
        for number in range(count):
            clock.append(number * EACH_S)
            anew = range(number + 1) if number > GROWTH * moved_at else (number,)
            if len(anew) > 1:
                moved_at, camera = number, Camera(4000, 3000, 1.4 + 1e-6 * number)
            start, before = time.process_time(), sizes(store.out)
            take(store, number)
            place(store, camera, anew)
            store.save(CANVAS, [IslandRecord(id=0, merged_into=None)], {0: number + 1})
            yield time.process_time() - start, written(before, sizes(store.out))


@contextmanager
def hurried() -> Iterator[list[float]]:
    """The last of these numbers is the time for whoever asks whether placements.json is due."""
    times = [0.0]
    with patch.object(placements, "time", SimpleNamespace(monotonic=lambda: times[-1])):
        yield times


def take(store: FlightStore, number: int) -> None:
    """A trigger and its frame have come."""
    name, now = f"IMG_{number:05}.JPG", number * EACH_S
    event = trigger_event(number, now, source_time=now, clock="boot", utc=1.7e9 + now, file_hint=name)
    taken = frame(name, now, content_hash=f"{number:064x}", size=4_000_000, modified=1.7e9 + now)
    ledger = store.ledger
    with ledger.transaction():
        ledger.record_frame(taken)
        ledger.settle_event(ledger.record_event(event), EventState.MATCHED, frame=name)


def place(store: FlightStore, camera: Camera, numbers: Iterable[int]) -> None:
    """These frames lie where they did not lie before; the last of them is new."""
    for number in numbers:
        name, pose = f"IMG_{number:05}.JPG", Pose(800.0 * (number % 40) + camera.focal, 600.0 * (number // 40))
        placement = Placement(
            name=name,
            island=0,
            pose=pose,
            camera=camera,
            relief=RELIEF,
            inliers=400,
            residual_px=0.5,
            neighbours=("a", "b"),
            hops=number // 3,
            corner_deviation_px=0.7,
        )
        store.note_placed([placement])
    store.note_painted(RenderItem(name=name, order=number, island=0, pose=pose, camera=camera, level=16))
    store.settle(name, FrameState.PLACED, None)
    store.note_measured(name, (camera.width, camera.height), 1.0)
    store.note_tiles([])


def sizes(out: Path) -> dict[str, tuple[int, int]]:
    """Number and length of each document."""
    return {path.name: (path.stat().st_ino, path.stat().st_size) for path in out.glob("*.json*")}


def written(before: dict[str, tuple[int, int]], after: dict[str, tuple[int, int]]) -> int:
    """Bytes: of a file that is another one all, else what was appended."""
    news = {name: (inode, size, before.get(name, (0, 0))) for name, (inode, size) in after.items()}
    return sum(size - (old[1] if old[0] == inode else 0) for inode, size, old in news.values())


if __name__ == "__main__":
    main()
