"""What an input costs, and whether what became of it is a find.

A find is an exception that a reader does not promise, more than `LONGEST_S` of computing time, or more than `MOST_MB` of memory;
a small file must cost little, whatever is in it. Time is that of the processor: a busy machine makes no finds.
"""

from __future__ import annotations

import re
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeAlias

Reader: TypeAlias = Callable[[bytes], object]

LONGEST_S = 2.0
MOST_MB = 300.0
_STATUS, _FORGET_PEAK = Path("/proc/self/status"), Path("/proc/self/clear_refs")  # Linux
_PEAK = re.compile(r"VmHWM:\s+(\d+) kB")
_NOW = re.compile(r"VmRSS:\s+(\d+) kB")


class TooLong(BaseException):
    """Raised where the time is over; no reader catches it."""


@dataclass(frozen=True, slots=True)
class Find:
    """`place`: the innermost line of the program, by which finds are told apart; `told`: all of it."""

    kind: str
    place: str
    told: str


def judged(read: Reader, data: bytes) -> Find | None:
    """Have an input read."""
    began, before = time.process_time(), _forgotten_peak()
    try:
        with _at_most(LONGEST_S):
            read(data)
    except (Exception, TooLong) as error:
        return Find(type(error).__name__, place_of(error), traceback.format_exc())
    seconds, grown = time.process_time() - began, (_megabytes(_PEAK) - before) if before else 0.0
    if seconds > LONGEST_S:
        return Find("slow", f"{len(data)} bytes", f"{seconds:.1f} s for {len(data)} bytes")
    if grown > MOST_MB:
        return Find("large", f"{round(grown, -2):.0f} MB", f"{grown:.0f} MB for {len(data)} bytes")
    return None


def place_of(error: BaseException) -> str:
    """File and line of the program, or of a library where the program is not in it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [one for one in frames if "gcs_mosaic" in one.filename]
    last = (ours or list(frames))[-1]
    return f"{Path(last.filename).name}:{last.lineno}"


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLong(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _forgotten_peak() -> float:
    """Memory in use now, in MB, from which the peak is counted; 0 where systems do not say."""
    try:
        _FORGET_PEAK.write_text("5")
    except OSError:
        return 0.0
    return _megabytes(_NOW)


def _megabytes(what: re.Pattern[str]) -> float:
    found = what.search(_STATUS.read_text())
    return int(found[1]) / 1024 if found else 0.0
