"""Worker process that adjusts whole islands while frames are being placed.

A process, not a thread: an adjustment is thousands of short array operations that would compete with the placing for the
interpreter lock. It runs at low priority, ends with the program, and is restarted if it dies.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Protocol

from gcs_mosaic.processes.child import ChildProcess, ending
from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjusted

logger = logging.getLogger(__name__)

NICENESS = 5  # of 19: placing and painting come first
WHAT = "the process that adjusts the map"
MOST_S = 900.0  # longest wait for a result that is due: 3,000 frames take half a minute on a core of their own


@dataclass(frozen=True, slots=True)
class WorkerFailed:
    """The adjustment failed, and why; `traceback`: of the worker process, if available."""

    reason: str
    traceback: str = ""


class InOtherProcess(Exception):  # noqa: N818 - its only use is to be logged
    """Carries the worker process' traceback into this process' log."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


class Worker(Protocol):
    """Adjusts islands in the background, one task at a time."""

    def begin(self, task: IslandTask) -> None:
        """Start a task, replacing the running one; whether that was possible shows in `result`."""

    def is_ready(self) -> bool:
        """Whether `result` would return at once."""

    def result(self) -> AdjustedIsland | WorkerFailed:
        """Result of the task begun last, never of another; waits for it, with a time limit. May be called again."""


class WorkerProcess:
    """A worker in a process of its own, started with the first task."""

    def __init__(self, most_s: float = MOST_S) -> None:
        self._most_s = most_s
        self._child: ChildProcess | None = None
        self._sender: threading.Thread | None = None
        self._is_at_work = False
        self._found: AdjustedIsland | WorkerFailed | None = None  # of the task begun last

    def begin(self, task: IslandTask) -> None:
        if self._is_at_work:  # its task is obsolete: its answer must not be taken for that of the new one
            self.close()
        self._is_at_work, self._found = True, None
        try:
            self._child = self._child or ChildProcess(WHAT, _work, niceness=NICENESS)
        except OSError as error:  # no memory, or too many processes
            logger.exception("%s cannot be started", WHAT)
            self._found = WorkerFailed(f"{WHAT} could not be started ({error.strerror})")
            return
        # In a thread: a newly started process takes a second before it reads, and a large task fills the pipe.
        self._sender = threading.Thread(target=_send, args=(self._child.pipe, task), name="adjust", daemon=True)
        self._sender.start()

    def is_ready(self) -> bool:
        return self._found is not None or self._child is None or self._child.pipe.poll()

    def result(self) -> AdjustedIsland | WorkerFailed:
        if self._found is None:
            self._found = self._received()
        self._is_at_work = False
        return self._found

    def _received(self) -> AdjustedIsland | WorkerFailed:
        if self._child is None:
            return WorkerFailed("no process is adjusting the map")
        try:
            if not self._child.pipe.poll(self._most_s):
                logger.error("%s has brought nothing for %g s", WHAT, self._most_s)
                self.close()
                return WorkerFailed(f"the map was not adjusted within {self._most_s:g} s")
            found = self._child.pipe.recv()
        except (EOFError, OSError):
            logger.error("%s has died, %s", WHAT, self._released(self._child), exc_info=True)
            return WorkerFailed(f"{WHAT} has died")
        except BaseException:  # the rest of an answer may still be in the pipe
            self.close()
            raise
        assert isinstance(found, AdjustedIsland | WorkerFailed)
        if isinstance(found, WorkerFailed):
            logger.error("%s", found.reason, exc_info=InOtherProcess(found.traceback))
        return found

    def close(self) -> None:
        """Kill the process, whatever it is doing."""
        if self._child is not None:
            self._child.kill()
            self._released(self._child)

    def _released(self, child: ChildProcess) -> str:
        """What nobody reads in any more; returns how it ended."""
        if self._sender is not None:
            self._sender.join()  # the reader is gone, so it has failed; until then the pipe is in use
        self._child = self._sender = None
        return ending(child.end())


def _send(pipe: Connection, task: IslandTask) -> None:
    with contextlib.suppress(OSError):  # the reader is gone: `result` finds out
        pipe.send(task)


def _work(pipe: Connection) -> None:
    """Tasks in, results out, until the other end is closed: at the latest when the program ends."""
    try:
        while True:
            pipe.send(_tried(pipe))
    except (EOFError, OSError):
        return


def _tried(pipe: Connection) -> AdjustedIsland | WorkerFailed:
    try:
        return adjusted(pipe.recv())
    except (EOFError, OSError):  # of the pipe: an adjustment reads no files
        raise
    except Exception as error:  # reported and logged by the caller; the process continues with the next task
        return WorkerFailed(f"the map could not be adjusted ({error!r})", traceback.format_exc())
