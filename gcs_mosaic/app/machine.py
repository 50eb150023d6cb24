"""What the program asks of the operating system: how its heap is held, and as many open files as it may have."""

from __future__ import annotations

import ctypes
from contextlib import suppress

# Options of glibc's malloc.h. Few arenas, shared by all threads: otherwise each thread has its own, of 64 MB and never returned
# once filled; for the threads that prepare, paint and write that is a quarter of the program's memory. Pictures of up to 32 MB
# come out of the heap, and up to 256 MB at its end are kept: otherwise a frame's pages are returned and zeroed anew many times.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
HEAP = {M_ARENA_MAX: 2, M_MMAP_THRESHOLD: 32 << 20, M_TRIM_THRESHOLD: 256 << 20}
MOST_FILES = 4096  # more than it ever needs; the usual limit of 1,024 is for programs that know no more than select()


def set_up_heap() -> None:
    """Tell glibc's malloc how to hold memory; call before starting any thread."""
    try:
        for option, value in HEAP.items():
            ctypes.CDLL(None).mallopt(option, value)
    except (OSError, AttributeError, TypeError):  # not glibc
        return


def give_back() -> None:
    """Return to the system what lies free between values that are in use. Takes some hundredths of a second.

    Each frame takes and frees some hundred MB, with something that stays in between: in a long flight a third of the heap is
    such holes.
    """
    with suppress(OSError, AttributeError):  # not glibc
        ctypes.CDLL(None).malloc_trim(0)


def allow_more_files() -> None:
    """Raise the limit as far as the system lets us, for this process and those that it starts."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if hard == resource.RLIM_INFINITY else min(MOST_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(ValueError):  # a system with a lower limit of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
