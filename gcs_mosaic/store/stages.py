"""When each processing stage of a frame ran, on which thread and core, and what it cost: logged to flight.log at debug level."""

from __future__ import annotations

import ctypes
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

logger = logging.getLogger(__name__)


@contextmanager
def stage(name: str, of: str) -> Iterator[None]:
    """Log the enclosed code as this stage, also if it raises. Nearly free unless the log level is debug.

    CPU seconds are those of this whole process meanwhile, whatever thread used them: a stage's own if nothing else ran.
    """
    if not logger.isEnabledFor(logging.DEBUG):
        yield
        return
    start, used = time.monotonic(), time.process_time()
    try:
        yield
    finally:
        end, cpu = time.monotonic(), time.process_time() - used
        logger.debug("%s %.4f to %.4f s, %.4f CPU s, on core %d: %s", name, start, end, cpu, _core(), of)


def _tells_core() -> Callable[[], int]:
    """A function that returns the current thread's core; -1 where unsupported."""
    try:
        return ctypes.CDLL(None).sched_getcpu
    except (OSError, AttributeError, TypeError):  # not Linux
        return lambda: -1


_core = _tells_core()
