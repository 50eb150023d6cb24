"""Seconds by stage: of the processor, and by the clock on the wall."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Stages:
    """Adds up what named stages cost."""

    def __init__(self) -> None:
        self.cpu_s: dict[str, float] = defaultdict(float)
        self.wall_s: dict[str, float] = defaultdict(float)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """What happens meanwhile belongs to this stage, also when it raises."""
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            yield
        finally:
            self.cpu_s[stage] += time.process_time() - cpu
            self.wall_s[stage] += time.perf_counter() - wall

    def include(self, other: Stages) -> None:
        """Add what others have measured."""
        for stage in other.wall_s:
            self.cpu_s[stage] += other.cpu_s[stage]
            self.wall_s[stage] += other.wall_s[stage]
