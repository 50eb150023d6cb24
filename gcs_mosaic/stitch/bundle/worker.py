"""Worker process that adjusts whole islands while frames are being placed.

A process, not a thread: an adjustment is thousands of short array operations that would compete with the placing for the
interpreter lock. It runs at low priority, ends with the program, and is restarted if it dies.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import multiprocessing
import os
import threading
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Protocol

from gcs_mosaic.children import outlive_signals, starting
from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjusted

logger = logging.getLogger(__name__)

NICENESS = 5  # of 19: placing and painting come first
GRACE_S = 1.0  # time for a process to exit by itself after its pipe is closed
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
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._sender: threading.Thread | None = None
        self._is_at_work = False
        self._found: AdjustedIsland | WorkerFailed | None = None  # of the task begun last

    def begin(self, task: IslandTask) -> None:
        if self._is_at_work:  # its task is obsolete: its answer must not be taken for that of the new one
            self.close()
        self._is_at_work, self._found = True, None
        # In a thread: a newly started process takes a second before it reads, and a large task fills the pipe.
        try:
            pipe = self._started()
        except OSError as error:  # no memory, or too many processes
            logger.exception("the process that adjusts the map cannot be started")
            self._found = WorkerFailed(f"the process that adjusts the map could not be started ({error.strerror})")
            return
        self._sender = threading.Thread(target=_send, args=(pipe, task), name="adjust", daemon=True)
        self._sender.start()

    def is_ready(self) -> bool:
        return self._found is not None or self._pipe is None or self._pipe.poll()

    def result(self) -> AdjustedIsland | WorkerFailed:
        if self._found is None:
            self._found = self._received()
        self._is_at_work = False
        return self._found

    def _received(self) -> AdjustedIsland | WorkerFailed:
        if self._pipe is None:
            return WorkerFailed("no process is adjusting the map")
        try:
            if not self._pipe.poll(self._most_s):
                logger.error("the process that adjusts the map has brought nothing for %g s", self._most_s)
                self.close()
                return WorkerFailed(f"the map was not adjusted within {self._most_s:g} s")
            found = self._pipe.recv()
        except (EOFError, OSError):
            logger.error("the process that adjusts the map has died, %s", self._last_sign(), exc_info=True)
            self.close()
            return WorkerFailed("the process that adjusts the map has died")
        except BaseException:  # the rest of an answer may still be in the pipe
            self.close()
            raise
        assert isinstance(found, AdjustedIsland | WorkerFailed)
        if isinstance(found, WorkerFailed):
            logger.error("%s", found.reason, exc_info=InOtherProcess(found.traceback))
        return found

    def close(self) -> None:
        """Kill the process, whatever it is doing."""
        if self._process is not None and self._pipe is not None:
            atexit.unregister(self._process.kill)
            self._process.kill()
            self._process.join()
            if self._sender is not None:
                self._sender.join()  # the reader is gone, so it has failed; until then the pipe is in use
            self._pipe.close()
        self._process = self._pipe = self._sender = None

    def _last_sign(self) -> str:
        """How the process ended: -9 is the system's answer to exhausted memory."""
        if self._process is None:
            return "it had been ended"
        self._process.join(GRACE_S)
        return f"exit code {self._process.exitcode}"

    def _started(self) -> Connection:
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")  # threads are running: a fork could inherit their locks
            ours, theirs = context.Pipe()
            with theirs:
                process = context.Process(target=_work, args=(theirs,), name="adjust", daemon=True)
                try:
                    with starting():
                        process.start()
                except BaseException:
                    ours.close()
                    raise
            atexit.register(process.kill)  # it does not end on a signal that is for the program
            self._pipe, self._process = ours, process
        return self._pipe


def _send(pipe: Connection, task: IslandTask) -> None:
    with contextlib.suppress(OSError):  # the reader is gone: `result` finds out
        pipe.send(task)


def _work(pipe: Connection) -> None:
    """Tasks in, results out, until the other end is closed: at the latest when the program ends."""
    outlive_signals()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)
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
