"""Loaded by a Python whose PYTHONPATH names this folder: its clock is off by as many seconds as the file WRONG_CLOCK says.

The monotonic clock stays right, as it does when somebody sets the time.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

EACH_S = 0.2  # between two looks at the file

_true, _true_ns = time.time, time.time_ns
_read_at, _off_s = float("-inf"), 0.0


def _off() -> float:
    global _read_at, _off_s
    now = time.monotonic()
    if now - _read_at > EACH_S:
        _read_at = now
        with suppress(OSError, ValueError):  # it is being written
            _off_s = float(Path(os.environ["WRONG_CLOCK"]).read_text(encoding="ascii"))
    return _off_s


if "WRONG_CLOCK" in os.environ:
    time.time = lambda: _true() + _off()
    time.time_ns = lambda: _true_ns() + int(_off() * 1e9)
