"""Delivers pictures into the watched folder as slow cards and cables do: late, and in pieces."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

PIECES = 4
AT_ONCE = 8  # concurrent files


def write_slowly(path: Path, data: bytes, seconds: float, pieces: int = PIECES) -> None:
    """Write a file in pieces over `seconds`, so that a watcher really sees it incomplete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    size = max(1, -(-len(data) // pieces))
    with path.open("wb") as file:
        for start in range(0, len(data), size):
            if start:
                time.sleep(seconds / pieces)
            file.write(data[start : start + size])
            file.flush()


@dataclass(slots=True)
class Delivery:
    """delay: seconds from the trigger to a file's first byte; writing: seconds from its first to its last byte."""

    lead: ClassVar[float] = 0.0  # seconds before the first trigger

    folder: Path
    delay: float = 0.4
    writing: float = 0.3
    pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(AT_ONCE, "delivery"))
    sent: list[Future[None]] = field(default_factory=list)

    def expect(self, data: bytes, due: float) -> None:
        """No-op: a file follows its trigger."""

    def send(self, name: str, data: bytes) -> None:
        """Start delivering a picture; returns at once."""
        self.sent.append(self.pool.submit(self.bring, self.folder / name, data))

    def bring(self, path: Path, data: bytes) -> None:
        time.sleep(self.delay)
        write_slowly(path, data, self.writing)

    def finish(self) -> None:
        """Wait for all pictures; raises the first error of any (such as a full disk)."""
        for future in self.sent:
            future.result()
        self.pool.shutdown()

    def abandon(self) -> None:
        """Finish files being written and drop the rest."""
        self.pool.shutdown(cancel_futures=True)
