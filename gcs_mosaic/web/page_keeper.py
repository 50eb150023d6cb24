"""The page of a live flight, kept up in a process of its own. Whatever becomes of that process, the flight does not wait.

A thread, `page`, passes on what either side has to tell, and starts another process when one has ended.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from typing import Literal

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Notice
from gcs_mosaic.processes.child import GRACE_S, ChildProcess, ending
from gcs_mosaic.processes.keeper import Silence, one_after_another
from gcs_mosaic.processes.pipe import Message, messages, was_logged
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web.change import Change
from gcs_mosaic.web.page_process import serve_page
from gcs_mosaic.web.page_task import PageTask

logger = logging.getLogger(__name__)

WHAT = "the page's process"
# Of 19: the flight comes first. Beside ten programs that want a core each, 10 leaves the page a fiftieth of one, and its answers
# take up to 12 s; 5 leaves it a sixteenth, and they take 0.7 s at most.
NICENESS = 5
START_S = 30.0  # until it listens: a loaded machine takes long to load it
LOOK_S = 0.1  # longest delay of a change


class PageKeeper:
    """Starts the page's process, tells it what was painted, and starts it again when it dies."""

    def __init__(self, task: PageTask) -> None:
        self._task = task
        self._news: queue.SimpleQueue[Notice] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._pending: Change | None = None
        self._stop, self._has_passed_all = threading.Event(), threading.Event()
        self._first: Future[Message] = Future()  # the first process' answer
        self._child: ChildProcess | None = None
        self._silence = Silence()
        self._is_lost = False
        self._thread = threading.Thread(target=self._keep, name="page", daemon=True)
        self._thread.start()

    def start(self) -> int | None:
        """Wait until it listens, and return the port; None if it takes too long, and then it is tried on. Raises UsageError."""
        try:
            answer = self._first.result(START_S)
        except TimeoutError:
            return None
        if "refused" in answer:
            self.stop()
            raise UsageError(answer["refused"])
        return answer.get("listening")

    def publish(self, revision: int, tiles: Iterable[tuple[int, Tile]] | None) -> None:
        """As `Feed.publish`: returns at once, whatever the process does."""
        change = Change.of_frame(revision, tiles)
        with self._lock:
            self._pending = change.after(self._pending)

    def news(self) -> list[Notice]:
        """What there is to say since the last call, to be called every second or so; ends a process that hangs."""
        if self._silence.is_too_long() and self._child is not None:
            logger.warning("%s gives no sign of life", WHAT)
            self._silence.heard()
            self._child.kill()
        return [self._news.get() for _ in range(self._news.qsize())]

    def stop(self) -> None:
        """Pass on what was published last, and end the process."""
        self._stop.set()
        if not self._has_passed_all.wait(GRACE_S) and self._child is not None:
            self._child.kill()  # it does not read
        self._thread.join()

    def _keep(self) -> None:
        for child in one_after_another(self._begun, WHAT, self._stop):
            answer = self._answer(child)
            if not self._first.done():
                self._first.set_result(answer)
                if "refused" in answer:  # which ends the program's start
                    break
            if "listening" in answer:
                self._serve(child, int(answer["listening"]))
            elif not self._stop.is_set():
                logger.warning("the page cannot be served: %s", answer.get("refused", "its process does not answer"))
            if self._stop.is_set():
                self._has_passed_all.set()
            elif not self._is_lost:
                how, self._is_lost = ending(child.end()), True
                self._say("warning", f"{WHAT} has ended ({how}): it is started again, and the flight goes on")
        self._has_passed_all.set()

    def _begun(self) -> ChildProcess:
        self._silence.heard()
        self._child = ChildProcess(WHAT, serve_page, self._task, niceness=NICENESS)
        return self._child

    def _answer(self, child: ChildProcess) -> Message:
        """Its first answer; empty if there is none in time, or it has ended."""
        until = time.monotonic() + START_S
        with suppress(EOFError, OSError):
            while time.monotonic() < until and not self._stop.is_set():
                for message, _ in messages(child.pipe, LOOK_S):
                    if "listening" in message or "refused" in message:
                        return message
                    self._hear(message)
        return {}

    def _serve(self, child: ChildProcess, port: int) -> None:
        """Pass on changes until the process has ended, or is to."""
        self._task = self._task.at(port)  # which the next process is to have
        if self._is_lost:
            self._is_lost = False
            self._say("info", "the page is there again")
        with suppress(EOFError, OSError):
            while not self._stop.is_set() or self._pending is not None:
                with self._lock:
                    change, self._pending = self._pending, None
                if change is not None:
                    child.pipe.send(change)
                for message, _ in messages(child.pipe, LOOK_S):
                    self._hear(message)

    def _hear(self, message: Message) -> None:
        """A log record, or nothing but a sign of life."""
        self._silence.heard()
        was_logged(message, WHAT)

    def _say(self, level: Literal["info", "warning"], text: str) -> None:
        self._news.put(Notice(source="page", level=level, text=text))
