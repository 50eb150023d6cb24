"""How far a command is that ends by itself: bars on a terminal, elsewhere a line each ten seconds; and progress.json."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, Task, TextColumn, TimeRemainingColumn

from gcs_mosaic.app.status.terminal import LINE_EACH_S
from gcs_mosaic.store.progress import ProgressFile, RunStep
from gcs_mosaic.store.told_documents import CommandName

logger = logging.getLogger(__name__)

REFRESHES = 4.0  # of the bars a second: drawing them takes the interpreter from the stitching
NOTHING = RunStep("starting", 0)


class RunProgress(Progress):
    """Bars that disappear when done, of the tasks that it is told of."""

    def __init__(self, console: Console) -> None:
        columns = (
            *(TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn()),
            TimeRemainingColumn(),
        )
        no_bars = not console.is_terminal
        super().__init__(*columns, console=console, transient=True, refresh_per_second=REFRESHES, disable=no_bars)
        self._lines = None if not no_bars or console.quiet else LinesNow(console, lambda: self.step.words())

    @property
    def step(self) -> RunStep:
        """Of the newest task."""
        tasks = self.tasks
        return step_of(tasks[-1]) if tasks else NOTHING

    def kept_in(self, folder: Path, command: CommandName) -> ProgressFile:
        """A context in which it is in progress.json of a flight's folder, too."""
        return ProgressFile(folder, command, lambda: self.step)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lines is not None:
            self._lines.close()
        super().__exit__(kind, error, trace)


class LinesNow:
    """Prints what `told` says each ten seconds, on a thread of its own, until `close`."""

    def __init__(self, console: Console, told: Callable[[], str], each_s: float | None = None) -> None:
        self._console, self._told, self._each_s = console, told, each_s or LINE_EACH_S
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._print, name="progress lines", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()

    def _print(self) -> None:
        while not self._end.wait(self._each_s):
            try:
                self._console.print(self._told(), markup=False, highlight=False, soft_wrap=True)
            except (OSError, SystemExit):  # the second is raised by rich on a broken pipe
                logger.info("the terminal is gone", exc_info=True)
                return


def step_of(task: Task) -> RunStep:
    """Where a task is; `left_s` by the speed of the last half minute."""
    total = None if task.total is None else round(task.total)
    return RunStep(task.description, round(task.completed), total, None if total is None else task.time_remaining)
