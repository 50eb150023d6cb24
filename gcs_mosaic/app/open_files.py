"""How many files the program may have open."""

from __future__ import annotations

import contextlib

MOST = 4096  # more than it ever needs; the usual limit of 1,024 is for programs that know no more than select()


def allow_more_files() -> None:
    """Raise the limit as far as the system lets us, for this process and those that it starts."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST if hard == resource.RLIM_INFINITY else min(MOST, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError):  # a system with a lower limit of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
