"""What a child process does first: `python -m gcs_mosaic.processes.main MODULE:FUNCTION NICENESS HANDLE`, run by `child`."""

from __future__ import annotations

import os
import select
import sys
import threading
import time
from importlib import import_module
from multiprocessing import connection

from gcs_mosaic.processes.limits import dump_no_core
from gcs_mosaic.processes.signals import outlive_signals

FAREWELL_S = 10.0  # for a process to end by itself when the program has gone


def main() -> None:
    """Call the function with the pipe, and with what comes from it first: the arguments, from the program, which is trusted."""
    outlive_signals()
    target, niceness, handle = sys.argv[1:]
    if hasattr(os, "nice"):  # Windows: by a flag at its start
        os.nice(int(niceness))
    dump_no_core()
    pipe = _pipe_of(int(handle))
    threading.Thread(target=_end_with_the_program, args=(pipe.fileno(),), name="farewell", daemon=True).start()
    module, _, name = target.partition(":")
    work = getattr(import_module(module), name)
    try:
        given = pipe.recv()
    except (EOFError, OSError):  # the program has ended
        return
    work(pipe, *given)


def _pipe_of(handle: int) -> connection.Connection:
    if sys.platform == "win32":
        return connection.PipeConnection(handle)
    return connection.Connection(handle)


def _end_with_the_program(descriptor: int) -> None:
    """Whatever this process is doing then: what hangs in a library hears of no closed pipe."""
    if hasattr(select, "poll"):  # not on Windows
        gone = select.poll()
        gone.register(descriptor, 0)  # that the other end is closed is told in any case
        gone.poll()
        time.sleep(FAREWELL_S)
        os._exit(1)


if __name__ == "__main__":
    main()
