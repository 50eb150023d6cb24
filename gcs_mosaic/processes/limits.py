"""What a child process may take of the machine, for itself to set; where systems can."""

from __future__ import annotations

import os
import signal
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

_STATM = Path("/proc/self/statm")  # Linux: pages of address space first


def dump_no_core() -> None:
    """What reads foreign data is expected to crash, and an image of its memory is for nobody."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def limit_time(cpu_s: float) -> None:
    """The system ends this process when all its threads have computed for so many seconds from now on; 0 for no limit."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, cpu_s)


def limit_memory(more_bytes: int) -> tuple[int, int] | None:
    """Refuse this process more memory than so much more; returns the limits to go back to, None if nothing was done."""
    if resource is None or not _STATM.exists():
        return None
    now = int(_STATM.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    before: tuple[int, int] = resource.getrlimit(resource.RLIMIT_AS)
    if any(limit != resource.RLIM_INFINITY and now + more_bytes > limit for limit in before):
        return None  # the operator's own limit is tighter
    resource.setrlimit(resource.RLIMIT_AS, (now + more_bytes, before[1]))
    return before


def lift_memory_limit(before: tuple[int, int] | None) -> None:
    """Back to what `limit_memory` returned."""
    if before is not None:
        resource.setrlimit(resource.RLIMIT_AS, before)
