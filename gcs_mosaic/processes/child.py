"""A child process as the program sees it: started, spoken with over a pipe, ended."""

from __future__ import annotations

import atexit
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any, BinaryIO

from gcs_mosaic.processes import main
from gcs_mosaic.processes.signals import starting

logger = logging.getLogger(__name__)

# -P: nothing is imported from the working directory.
PROGRAM = (sys.executable, "-P", "-m", main.__name__)
GRACE_S = 3.0  # for a process whose pipe is closed to end by itself
MOST_WORDS = (
    50  # lines that one process prints which are logged; the others are read, so that it never waits, and dropped
)
LONGEST_WORDS = 1 << 12  # bytes of such a line


class ChildProcess:
    """Runs `target(pipe, *given)`, a module's function, in a process of its own. Raises OSError if it cannot start.

    `target` ends when its end of `pipe` says that ours is closed; the process is ended if it does not, and with the program.
    `what`: as the log is to call it. `shared`: descriptors that it is to have under the same numbers. What it prints is logged.
    """

    def __init__(
        self, what: str, target: Callable[..., None], *given: Any, niceness: int = 0, shared: Sequence[int] = ()
    ) -> None:
        self.pipe, theirs = Pipe()
        try:
            with starting(), theirs:
                self._process = _started(target, niceness, (theirs.fileno(), *shared))
        except BaseException:
            self.pipe.close()
            raise
        self.pid = self._process.pid
        atexit.register(self.kill)  # it does not end on a signal that is for the program
        self._words = threading.Thread(target=_log_words, args=(self._process.stdout, what), name="words", daemon=True)
        try:
            self._words.start()
            with suppress(OSError):  # it has ended already, which its pipe tells
                self.pipe.send(given)
        except BaseException as error:
            self._abandon()
            if isinstance(error, RuntimeError):  # no more threads
                raise OSError(str(error)) from error
            raise

    def kill(self) -> None:
        """End it, whatever it is doing; whoever waits for it is told. From any thread."""
        self._process.kill()

    def end(self, grace_s: float = GRACE_S) -> int:
        """Close its pipe and wait for its end, which is brought about if need be; returns its exit code. May be called again."""
        self.pipe.close()
        try:
            code = self._process.wait(grace_s)
        except subprocess.TimeoutExpired:
            self.kill()
            code = self._process.wait()
        atexit.unregister(self.kill)
        self._words.join(GRACE_S)
        return code

    def _abandon(self) -> None:
        """Leave nothing of one that could not begin."""
        self.pipe.close()
        self.kill()
        self._process.wait()
        atexit.unregister(self.kill)
        if self._words.ident is None and self._process.stdout is not None:  # the thread would close it
            self._process.stdout.close()


def ending(code: int | None) -> str:
    """How a process has ended, by its exit code; None: it was ended because it did not answer. Memory that ran out is SIGKILL."""
    if code is None:
        return "no answer"
    if code >= 0:
        return f"exit code {code}"
    names = {one.value: one.name for one in signal.Signals}
    return names.get(-code, f"signal {-code}")


def _started(target: Callable[..., None], niceness: int, handles: Sequence[int]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*PROGRAM, f"{target.__module__}:{target.__qualname__}", str(niceness), str(handles[0])],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(place or str(Path.cwd()) for place in sys.path)},
        **_apart(niceness, handles),
    )


def _apart(niceness: int, handles: Sequence[int]) -> dict[str, Any]:
    """Ctrl-C and a closed terminal are not for a child, in the system's own way: it is in no group that they are sent to."""
    if sys.platform == "win32":
        for handle in handles:
            os.set_handle_inheritable(handle, True)
        apart = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
        return {
            "creationflags": apart | (subprocess.BELOW_NORMAL_PRIORITY_CLASS if niceness else 0),
            "startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": list(handles)}),
        }
    return {"pass_fds": handles, "process_group": 0}


def _log_words(out: BinaryIO, what: str) -> None:
    """What a process prints, until its end: Python's and libraries' last words."""
    with out:
        for number, line in enumerate(iter(lambda: out.readline(LONGEST_WORDS), b"")):
            if number < MOST_WORDS:
                logger.warning("%s: %s", what, line.decode("utf-8", "replace").rstrip())
