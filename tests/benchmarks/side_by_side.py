"""The same work on several things, each in a process of its own, some at a time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

Given = TypeVar("Given")
Result = TypeVar("Result")

LONGEST_WAIT_S = 10.0  # how long a process may take to clean up when it is stopped


@dataclass(frozen=True, slots=True)
class Failed:
    """Work that has come to nothing, and why."""

    reason: str

    def __str__(self) -> str:
        return self.reason


def each(
    work: Callable[[Given], Result], things: Sequence[Given], jobs: int = 1
) -> Iterator[tuple[Given, Result | Failed]]:
    """Things and what has come of them, as they get ready. When it is left early, nothing goes on running."""
    left = list(enumerate(things))
    running: dict[Connection, tuple[int, BaseProcess]] = {}
    try:
        while left or running:
            while left and len(running) < max(1, jobs):
                number, thing = left.pop(0)
                pipe, process = _started(work, thing)
                running[pipe] = (number, process)
            for ready in wait(list(running)):
                assert isinstance(ready, Connection)
                number, process = running[ready]
                outcome = _received(ready, process)
                del running[ready]
                yield things[number], outcome
    finally:
        _stop([process for _, process in running.values()])


def _started(work: Callable[[Given], Result], thing: Given) -> tuple[Connection, BaseProcess]:
    context = multiprocessing.get_context("spawn")  # a process that begins with nothing in memory
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(work, thing, theirs))
    process.start()
    theirs.close()
    return ours, process


def _work(work: Callable[[Given], Result], thing: Given, pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, which ends this process itself
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        pipe.send(work(thing))
    except KeyboardInterrupt:
        os._exit(1)  # all that had to be cleaned up is
    except Exception as error:
        traceback.print_exc()
        pipe.send(Failed(f"{type(error).__name__}: {error}"))


def _received(pipe: Connection, process: BaseProcess) -> Any:
    try:
        return pipe.recv()
    except EOFError:
        process.join()
        return Failed(f"the process ended with {process.exitcode}")
    finally:
        process.join()
        pipe.close()


def _stop(processes: Sequence[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(LONGEST_WAIT_S)
        process.kill()
