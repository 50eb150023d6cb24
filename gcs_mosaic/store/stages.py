"""When each processing stage of a frame ran, on which thread and core: logged to flight.log at debug level."""

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
    """A processing stage. Times are seconds on the host's monotonic clock; core -1: unknown on this system."""

    name: str
    of: str  # the frame, or other object processed
    thread: str
    core: int
    start: float
    end: float


@contextmanager
def stage(name: str, of: str) -> Iterator[None]:
    """Log the enclosed code as this stage, also if it raises. Nearly free unless the log level is debug."""
    if not logger.isEnabledFor(logging.DEBUG):
        yield
        return
    start = time.monotonic()
    try:
        yield
    finally:
        logger.debug("%s %.4f to %.4f s on core %d: %s", name, start, time.monotonic(), _core(), of)


def stages_in(log: Iterable[str]) -> Iterator[Stage]:
    """The stages recorded in the lines of a flight.log, in the order they ended."""
    for line in log:
        if found := _LINE.search(line.rstrip("\n")):
            thread, name, start, end, core, of = found.groups()
            yield Stage(name, of, thread, int(core), float(start), float(end))


def _tells_core() -> Callable[[], int]:
    """A function that returns the current thread's core; -1 where unsupported."""
    try:
        return ctypes.CDLL(None).sched_getcpu
    except (OSError, AttributeError, TypeError):  # not Linux
        return lambda: -1


_core = _tells_core()
