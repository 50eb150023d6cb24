"""How the system's allocator keeps memory that threads have given back."""

from __future__ import annotations

import ctypes

M_ARENA_MAX = -8  # glibc's number for it
ARENAS = 2


def share_heap() -> None:
    """Let all threads share a few heaps, where the system is glibc's; to be called before there are any.

    Else each thread has its own, of 64 MB and never given back once it was full: with those that prepare, paint and write, a
    quarter of all that the program takes.
    """
    try:
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, ARENAS)
    except (OSError, AttributeError, TypeError):  # another system, which has no such thing
        return
