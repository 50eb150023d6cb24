"""Log records of what others do to the page, which may be anything, any number of times a second."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

REPEATED_S = 60.0  # records of one line of code are this far apart


class SparingHandler(logging.Handler):
    """Passes a record on as text, but of one line of code at most one in `REPEATED_S`: the sender may be anybody."""

    def __init__(self, put: Callable[[str, int], None]) -> None:
        super().__init__()
        self._put = put
        self._last: dict[tuple[str, int], tuple[float, int]] = {}  # when passed on, and how many were not since

    def emit(self, record: logging.LogRecord) -> None:
        place, now = (record.pathname, record.lineno), time.monotonic()
        passed, left_out = self._last.get(place, (-REPEATED_S, 0))
        if now - passed < REPEATED_S:
            self._last[place] = passed, left_out + 1
            return
        self._last[place] = now, 0
        more = f" (and {left_out} more like it)" if left_out else ""
        self._put(f"{self.format(record)}{more}", record.levelno)
