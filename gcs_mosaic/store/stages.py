"""When each processing stage of a frame ran, on which thread and core: logged to flight.log at debug level."""

from __future__ import annotations

import ctypes
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

logger = logging.getLogger(__name__)


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


def _tells_core() -> Callable[[], int]:
    """A function that returns the current thread's core; -1 where unsupported."""
    try:
        return ctypes.CDLL(None).sched_getcpu
    except (OSError, AttributeError, TypeError):  # not Linux
        return lambda: -1


_core = _tells_core()
