"""What the program asks of the operating system: a shared heap, and as many open files as it may have."""

from __future__ import annotations

import ctypes
from contextlib import suppress

M_ARENA_MAX = -8  # from glibc's malloc.h
ARENAS = 2
MOST_FILES = 4096  # more than it ever needs; the usual limit of 1,024 is for programs that know no more than select()


def share_heap() -> None:
    """Limit glibc's malloc to a few arenas shared by all threads; call before starting any thread.

    Otherwise each thread has its own, of 64 MB and never returned once filled: for the threads that prepare, paint and write, a
    quarter of the program's memory.
    """
    try:
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, ARENAS)
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
