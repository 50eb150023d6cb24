"""The page of a live flight, kept up in a process of its own. Whatever becomes of that process, the flight does not wait.

Two threads pass on what either side has to tell: `page` writes to the process, and starts another when it has ended; `page news`
reads from it.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from gcs_mosaic.children import starting
from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web.change import Change
from gcs_mosaic.web.page_task import PageTask

logger = logging.getLogger(__name__)

PROGRAM = (
    sys.executable,
    "-P",
    "-m",
    "gcs_mosaic.web.page_process",
)  # -P: nothing is imported from the working directory
START_S = 30.0  # until it listens: a loaded machine takes long to load it
LOOK_S = 0.5  # between looks whether it has ended
STOP_S = 3.0  # to end by itself
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 10.0  # before another is started; doubles while none lives
LIVED_S = 30.0  # then what ended it is not the start itself
HUNG_LOOKS, SIGHT_S = 30, 1.0  # so many looks, so far apart, without a sign of life: it hangs
LONGEST_LINE = 1 << 16
STRAY_LINES = 50  # of a process, that are no JSON: what Python says when it crashes


class PageKeeper:
    """Starts the page's process, tells it what was painted, and starts it again when it dies."""

    def __init__(self, task: PageTask) -> None:
        self._task = task
        self._child = _Child(task)
        self._news: queue.SimpleQueue[Notice] = queue.SimpleQueue()
        self._condition = threading.Condition()
        self._pending: Change | None = None
        self._ending = False
        self._thread = threading.Thread(target=self._keep, name="page", daemon=True)
        self._looked, self._hung_looks = 0.0, 0

    def start(self) -> int | None:
        """Wait until it listens, and return the port; None if it takes too long, and then it is tried on. Raises UsageError."""
        answer = self._child.answer(START_S)
        if "refused" in answer:
            self._child.end()
            raise UsageError(answer["refused"])
        port = self._listens(answer)
        self._thread.start()
        return port

    def publish(self, revision: int, tiles: Iterable[tuple[int, Tile]] | None) -> None:
        """As `Feed.publish`: returns at once, whatever the process does."""
        with self._condition:
            self._pending = Change.of_frame(revision, tiles).after(self._pending)
            self._condition.notify()

    def news(self) -> list[Notice]:
        """What there is to say since the last call, to be called every second or so; ends a process that hangs."""
        self._end_if_hung(time.monotonic())
        return [self._news.get() for _ in range(self._news.qsize())]

    def stop(self) -> None:
        """Pass on what was published last, and end the process."""
        with self._condition:
            self._ending = True
            self._condition.notify()
        if self._thread.ident is not None:
            self._thread.join(STOP_S)
        while self._thread.is_alive():  # it waits for a process that does not read, or does not start
            self._child.kill()
            self._thread.join(LOOK_S)
        self._child.end()

    def _keep(self) -> None:
        pause = FIRST_PAUSE_S
        while not self._ending:
            began = time.monotonic()
            self._serve(self._child)
            if self._ending:
                return
            if time.monotonic() - began > LIVED_S:
                pause = FIRST_PAUSE_S
            self._say_it_is_gone()
            pause = self._start_another(pause)
            if not self._ending:
                self._say("info", "the page is there again")

    def _serve(self, child: _Child) -> None:
        """Pass on changes until the process has ended, or is to."""
        with suppress(OSError):  # it has just ended
            while not child.has_ended:
                with self._condition:
                    if self._pending is None and not self._ending:
                        self._condition.wait(LOOK_S)
                    change, self._pending = self._pending, None
                if change is not None:
                    child.tell(change.json())
                elif self._ending:
                    return

    def _start_another(self, pause: float) -> float:
        """Until one listens; returns the pause before the next time."""
        while not self._ending:
            with self._condition:
                self._condition.wait_for(lambda: self._ending, pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
            if self._ending:
                break
            try:
                self._child = _Child(self._task)
            except OSError:
                logger.warning("the page's process cannot be started", exc_info=True)
                continue
            answer = self._child.answer(START_S)
            if self._listens(answer) is not None:
                break
            self._child.end()
            logger.warning("the page cannot be served: %s", answer.get("refused", "its process does not answer"))
        return pause

    def _listens(self, answer: dict[str, Any]) -> int | None:
        """The port in a process' first answer, which is kept for the next process."""
        port = answer.get("listening")
        if port is not None:
            self._task = self._task.at(port)
        return port

    def _say_it_is_gone(self) -> None:
        code = self._child.end()
        self._say("warning", f"the page's process has ended ({code}): it is started again, and the flight goes on")

    def _say(self, level: Any, text: str) -> None:
        self._news.put(Notice(source="page", level=level, text=text))

    def _end_if_hung(self, now: float) -> None:
        """Counts looks and not seconds, which also pass while this program or the machine is asleep."""
        if now - self._looked < SIGHT_S:
            return
        self._looked = now
        self._hung_looks = 0 if self._child.gave_a_sign() else self._hung_looks + 1
        if self._hung_looks >= HUNG_LOOKS:
            logger.warning("the page's process has given no sign of life for %d s", HUNG_LOOKS * SIGHT_S)
            self._hung_looks = 0
            self._child.kill()


class _Child:
    """The process, its pipes, and the thread that reads from it."""

    def __init__(self, task: PageTask) -> None:
        with starting():
            self._process = subprocess.Popen(
                PROGRAM,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                bufsize=0,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(place or str(Path.cwd()) for place in sys.path)},
                # Ctrl-C in the terminal is not for it.
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )
        self._answers: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._sign = True
        self._reader = threading.Thread(target=self._read, name="page news", daemon=True)
        self._reader.start()
        with suppress(OSError):  # it has ended already, which `answer` tells
            self.tell(task.json())

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def tell(self, line: str) -> None:
        """Waits for as long as it does not read. Raises OSError when it has ended."""
        rest = memoryview(f"{line}\n".encode())
        while rest:
            rest = rest[_pipe(self._process.stdin).write(rest) or 0 :]

    def answer(self, timeout_s: float) -> dict[str, Any]:
        """Its first answer; empty if there is none in time, or it has ended."""
        with suppress(queue.Empty):
            return self._answers.get(timeout=timeout_s)
        return {}

    def gave_a_sign(self) -> bool:
        """Whether it has told anything since the last call."""
        sign, self._sign = self._sign, False
        return sign

    def kill(self) -> None:
        self._process.kill()

    def end(self) -> str:
        """Close its input and wait for its end, which is brought about if need be; returns how it ended. May be called again."""
        _pipe(self._process.stdin).close()
        try:
            code = self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        self._reader.join(STOP_S)
        _pipe(self._process.stdout).close()
        return f"exit code {code}" if code >= 0 else f"signal {-code}"

    def _read(self) -> None:
        stray = 0
        out = _pipe(self._process.stdout)
        with suppress(ValueError, OSError):  # closed meanwhile
            while line := out.readline(LONGEST_LINE):
                self._sign = True
                try:
                    self._hear(json.loads(line))
                except (ValueError, TypeError, AttributeError):
                    stray += 1
                    if stray <= STRAY_LINES:
                        logger.warning("the page's process: %s", line.decode("utf-8", "replace").rstrip())
        self._answers.put({})

    def _hear(self, told: dict[str, Any]) -> None:
        if "log" in told:
            level, text = told["log"]
            logger.log(int(level), "the page's process: %s", text)
        elif "alive" not in told:
            self._answers.put(told)


def _pipe(end: Any) -> BinaryIO:
    pipe: BinaryIO = end
    return pipe
