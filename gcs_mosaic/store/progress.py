"""progress.json: how far a command is that ends by itself (stitch, merge, replay, reprocess), for `gcs-mosaic status`."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.documents import iso_utc, write_json
from gcs_mosaic.store.folder import PROGRESS_NAME
from gcs_mosaic.store.told_documents import FORMAT, CommandName, ProgressDocument

logger = logging.getLogger(__name__)

EACH_S = 1.0
HUNG_AFTER_S = 30.0  # a busy machine gives the thread that writes it no turn for seconds


class RunStep(NamedTuple):
    """What is being done; `of`, `left_s`: None where nobody knows."""

    doing: str
    done: int
    of: int | None = None
    left_s: float | None = None

    def words(self) -> str:
        """In a line."""
        count = f"{self.done}" if self.of is None else f"{self.done} of {self.of}"
        return f"{self.doing}: {count}{'' if self.left_s is None else f', {left_words(self.left_s)} left'}"


class ProgressFile:
    """A context in which progress.json is written each second, on a thread of its own; a disk that is full stops nothing.

    `look` is asked for the step on that thread. A run that fails leaves no file: the terminal has said why.
    """

    def __init__(self, folder: Path, command: CommandName, look: Callable[[], RunStep]) -> None:
        self._folder, self._command, self._look = folder, command, look
        self._started, self._end = time.time(), threading.Event()
        self._thread = threading.Thread(target=self._keep, name="progress", daemon=True)

    def __enter__(self) -> None:
        self._write("running")
        self._thread.start()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end.set()
        self._thread.join()
        if kind is None:
            self._write("ended")
            return
        try:
            inside.remove(self._folder / PROGRESS_NAME, self._folder)
        except OSError:
            logger.debug("%s cannot be removed", PROGRESS_NAME, exc_info=True)

    def _keep(self) -> None:
        while not self._end.wait(EACH_S):
            self._write("running")

    def _write(self, state: Literal["running", "ended"]) -> None:
        step = self._look()
        document = ProgressDocument(
            format=FORMAT,
            command=self._command,
            state=state,
            started=iso_utc(self._started),
            updated=iso_utc(time.time()),
            doing=step.doing,
            done=step.done,
            of=step.of,
            seconds_left=None if step.left_s is None else round(step.left_s, 1),
        )
        try:
            write_json(self._folder / PROGRESS_NAME, document)
        except (CannotWrite, OSError):  # the map's writer reports it
            logger.debug("%s cannot be written", PROGRESS_NAME, exc_info=True)


def progress_lines(document: dict[str, Any], age_s: float) -> list[str]:
    """The document as text; `age_s`: since it was written."""
    head = f"{document['command']}: {document['state']}, begun {document['started']}, {document['updated']}"
    if document["state"] != "running":
        return [head]
    step = RunStep(document["doing"], document["done"], document["of"], document["seconds_left"])
    hangs = [f"nothing was written for {age_s:.0f} s: the program was killed or hangs"] if age_s > HUNG_AFTER_S else []
    return [head, *hangs, step.words()]


def left_words(seconds: float) -> str:
    """A time to be waited for."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def progress_json(document: dict[str, Any], mosaic: dict[str, Any]) -> str:
    """For programs: with the counts of mosaic.json, where there is one."""
    return json.dumps(document | {name: mosaic[name] for name in ("frames", "events") if name in mosaic}, indent=2)
