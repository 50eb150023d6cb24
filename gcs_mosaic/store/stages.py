"""When each stage of a frame's work ran, on which thread and core: written into flight.log if that is to hold everything."""

from __future__ import annotations

import ctypes
import logging
import re
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

logger = logging.getLogger(__name__)

_LINE = re.compile(r" DEBUG (\S+) gcs_mosaic\.store\.stages: (\w+) ([\d.]+) to ([\d.]+) s on core (-?\d+): (.*)$")


@dataclass(frozen=True, slots=True)
class Stage:
    """A piece of work. Moments are seconds on the host's monotonic clock; core -1: the system does not tell."""

    name: str
    of: str  # the frame, or whatever it was done to
    thread: str
    core: int
    start: float
    end: float


@contextmanager
def stage(name: str, of: str) -> Iterator[None]:
    """What happens meanwhile is this stage, also when it raises. Costs next to nothing where the log leaves out details."""
    if not logger.isEnabledFor(logging.DEBUG):
        yield
        return
    start = time.monotonic()
    try:
        yield
    finally:
        logger.debug("%s %.4f to %.4f s on core %d: %s", name, start, time.monotonic(), _core(), of)


def stages_in(log: Iterable[str]) -> Iterator[Stage]:
    """The stages that the lines of a flight.log tell of, in the order in which they ended."""
    for line in log:
        if found := _LINE.search(line.rstrip("\n")):
            thread, name, start, end, core, of = found.groups()
            yield Stage(name, of, thread, int(core), float(start), float(end))


def _tells_core() -> Callable[[], int]:
    """What tells the core that a thread is on; -1 where the system does not."""
    try:
        return ctypes.CDLL(None).sched_getcpu
    except (OSError, AttributeError, TypeError):  # no Linux
        return lambda: -1


_core = _tells_core()
