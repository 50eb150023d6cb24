"""What an operator sees of a running flight: lines that stay, and below them one that tells how it is and is written over.

Where nobody sits at a terminal (a pipe, a file, a journal) nothing can be written over: how it is becomes a line now and then.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import datetime

from rich.console import Console
from rich.control import Control
from rich.markup import escape
from rich.segment import ControlType
from rich.text import Text

logger = logging.getLogger(__name__)

LINE_EACH_S = 10.0  # between two lines where they pile up
ERASE = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))


class Terminal:
    """A terminal that may be gone: that must not end a flight. Not thread-safe.

    `states`: whether it is told how the flight is; `timed`: whether each line begins with the time of day.
    """

    def __init__(
        self, console: Console, *, states: bool = True, timed: bool = True, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._console, self._states, self._timed, self._now = console, states, timed, now
        self._overwrites = console.is_terminal and not console.is_dumb_terminal
        self._shown = False  # whether the last line is to be written over
        self._told, self._due = "", now() + LINE_EACH_S

    def line(self, text: str, style: str = "") -> None:
        """A line that stays."""
        self._try(lambda: self._print(text, style))

    def state(self, text: str) -> None:
        """How it is now: over what was told last, or as a line of its own each ten seconds if it is another."""
        if self._states and self._overwrites:
            self._try(lambda: self._show(text))
        elif self._states and text != self._told and self._now() >= self._due:
            self._told, self._due = text, self._now() + LINE_EACH_S
            self.line(text)

    def close(self) -> None:
        """What is printed from now on by others begins on a line of its own."""
        self._try(self._erase)

    def _print(self, text: str, style: str) -> None:
        self._erase()
        self._console.print(self._begun(escape(text)), style=style, highlight=False, soft_wrap=True)

    def _show(self, text: str) -> None:
        line = Text(self._begun(text))
        line.truncate(
            self._console.width - 1, overflow="ellipsis"
        )  # in the last column some terminals begin another line
        self._erase()
        self._console.print(line, end="", highlight=False, soft_wrap=True)
        self._shown = True

    def _erase(self) -> None:
        if self._shown:
            self._console.control(ERASE)
            self._shown = False

    def _try(self, work: Callable[[], None]) -> None:
        try:
            work()
        except (OSError, SystemExit):  # the second is raised by rich on a broken pipe
            logger.info("the terminal is gone", exc_info=True)
            self._console, self._shown = Console(quiet=True), False

    def _begun(self, text: str) -> str:
        return f"{datetime.now():%H:%M:%S} {text}" if self._timed else text
