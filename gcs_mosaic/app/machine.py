"""What the program asks of the operating system: a heap shared and kept, and as many open files as it may have."""

from __future__ import annotations

import ctypes
from contextlib import suppress

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # from glibc's malloc.h
ARENAS = 2
KEPT_BYTES = 64 << 20  # free at the end of a heap, before it goes back to the system
HEAPED_BYTES = 32 << 20  # whatever is larger is asked from the system each time: whole pictures, in huge pages
MOST_FILES = 4096  # more than it ever needs; the usual limit of 1,024 is for programs that know no more than select()


def share_heap() -> None:
    """Limit glibc's malloc to a few arenas shared by all threads, which keep what they free; call before starting any thread.

    Otherwise each thread has its own, of 64 MB and never returned once filled: for the threads that prepare, paint and write, a
    quarter of the program's memory. And each intermediate picture would be fetched from the system page by page, and given back:
    twice the page faults, a twentieth of the computing time (`give_back` returns them now and then).
    """
    try:
        malloc = ctypes.CDLL(None)
        for option, value in (
            (M_ARENA_MAX, ARENAS),
            (M_TRIM_THRESHOLD, KEPT_BYTES),
            (M_MMAP_THRESHOLD, HEAPED_BYTES),
        ):
            malloc.mallopt(option, value)
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
