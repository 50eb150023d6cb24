"""Standard streams that were closed when the program was started (`>&-`), and those whose reader has gone."""

from __future__ import annotations

import os
import select
import sys


def open_standard_streams() -> None:
    """Open those that are closed to nowhere, before anything else is opened: a ledger in their place would be printed into."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
    sys.stdin = sys.stdin or open(0, encoding="utf-8")  # noqa: SIM115 -- a number, open until the end
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8")  # noqa: SIM115


def reader_has_gone() -> bool:
    """Whether nobody reads standard output any more, as behind `| head`; False where the system does not tell (Windows)."""
    if not hasattr(select, "poll"):
        return False
    poll = select.poll()
    poll.register(1, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def flush_or_let_go() -> None:
    """A closed pipe must not change the exit code, as it would if Python's own final flush failed."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
