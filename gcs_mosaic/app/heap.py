"""Tuning of the system's memory allocator."""

from __future__ import annotations

import ctypes
from contextlib import suppress

M_ARENA_MAX = -8  # from glibc's malloc.h
ARENAS = 2


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
