"""The stages that a flight's log has recorded."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

_LINE = re.compile(
    r" DEBUG (\S+) gcs_mosaic\.store\.stages: (\w+) ([\d.]+) to ([\d.]+) s, ([\d.]+) CPU s, on core (-?\d+): (.*)$"
)


@dataclass(frozen=True, slots=True)
class Stage:
    """A processing stage. Times are seconds on the host's monotonic clock; core -1: unknown on this system."""

    name: str
    of: str  # the frame, or other object processed
    thread: str
    core: int
    start: float
    end: float
    cpu: float = 0.0  # of the whole process meanwhile


def stages_in(log: Iterable[str]) -> Iterator[Stage]:
    """The stages recorded in the lines of a flight.log, in the order they ended."""
    for line in log:
        if found := _LINE.search(line.rstrip("\n")):
            thread, name, start, end, cpu, core, of = found.groups()
            yield Stage(name, of, thread, int(core), float(start), float(end), float(cpu))
