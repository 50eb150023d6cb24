"""What is sent to all processes of the program at once is for the program, which ends its children itself.

A closed terminal (SIGHUP), Ctrl-C (SIGINT) and a service manager (SIGTERM) reach more than one process. The program then
finishes the flight, and needs its children for that.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

FOR_THE_PROGRAM = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # POSIX but for the last, which is of Windows


def outlive_signals() -> None:
    """For a child, first of all: leave those signals to the program, also those that came while it was starting."""
    for number in _numbers():
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _numbers())


@contextmanager
def starting() -> Iterator[None]:
    """For the program, while it starts a child: until that calls `outlive_signals`, none of those signals can end it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _numbers())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _numbers() -> list[int]:
    return [getattr(signal, name) for name in FOR_THE_PROGRAM if hasattr(signal, name)]
