"""What it costs to bring a frame to the disk before its row: python -m tests.benchmarks.durable FOLDER [--mb 5] [--frames 40]

Originals are kept and recorded in FOLDER as in flight, with the waiting for the disk and without it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from statistics import median
from unittest.mock import patch

from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.originals import OriginalsSettings


def seconds_each(folder: Path, frames: int, size: int) -> list[float]:
    """Seconds that each frame takes: its original kept, its row written, the ledger synced."""
    taken = list[float]()
    with tempfile.TemporaryDirectory(dir=folder) as out:
        store = FlightStore(Path(out), originals=OriginalsSettings(reserve_gb=0.0))
        for number in range(frames):
            data = os.urandom(size)
            name = f"{number}.jpg"
            start = time.perf_counter()
            store.accept(
                Frame(
                    name=name,
                    path=Path(name),
                    content_hash=content_hash(data),
                    size=size,
                    received=0.0,
                    modified=0.0,
                    data=data,
                )
            )
            store.ledger.make_durable()
            taken.append(time.perf_counter() - start)
        store.close()
    return taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mb", type=float, default=5.0)
    parser.add_argument("--frames", type=int, default=40)
    asked = parser.parse_args()
    size = round(asked.mb * 1e6)
    sure = seconds_each(asked.folder, asked.frames, size)
    with patch("os.fsync", lambda descriptor: None):
        hasty = seconds_each(asked.folder, asked.frames, size)
    for name, taken in (("waiting for the disk", sure), ("not waiting", hasty)):
        print(f"{name}: median {median(taken) * 1000:.1f} ms, longest {max(taken) * 1000:.1f} ms")


if __name__ == "__main__":
    main()
