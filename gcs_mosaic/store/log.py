"""flight.log: what was said, refused and caught during a flight, for whoever must find out afterwards what went wrong.

A record is a line: UTC, level, thread, logger, message; the lines of a traceback follow behind a bar. File names, texts from
the link and words of exceptions come from outside: nothing in them can look like another record.
"""

from __future__ import annotations

import io
import logging
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Literal

from gcs_mosaic.messages import Notice
from gcs_mosaic.store.documents import iso_utc

BAR = "  | "  # before each line of a traceback
LEVELS = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

# User, password and host of a stream's address, then all that follows; paths carry passwords too, and passwords quotes.
_STREAM = re.compile(r"(?i)\b(rtsps?)://(?:\S*@)?([^/\s'\"?#]*)(\S*)")
_HARMLESS_PATH = re.compile(r"[/\w.-]{0,80}['\"]?[])},;:]*", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSettings:
    """What is written into flight.log."""

    # what is less important is not written; debug: each pair of frames that was believed, too
    level: Literal["debug", "info", "warning", "error"] = "info"
    file_mb: int = 10  # size at which flight.log becomes flight.log.1 and a new one is begun
    files: int = 5  # how many of them are kept, the oldest is removed
    verbose: bool = False  # the same on the terminal (standard error), without tracebacks

    def __post_init__(self) -> None:
        if self.file_mb < 1:
            raise ValueError(f"file_mb: expected 1 or more, got {self.file_mb}")
        if self.files < 2:
            raise ValueError(f"files: expected 2 or more, of which one is being written, got {self.files}")


class LogFile(RotatingFileHandler):
    """Writes records to `path` and never raises. `trouble` is called once with why a record could not be written."""

    def __init__(self, path: Path, settings: LogSettings, trouble: Callable[[str], None]) -> None:
        size, older = settings.file_mb * 1_000_000, settings.files - 1
        super().__init__(path, maxBytes=size, backupCount=older, encoding="utf-8", delay=True)
        self.setFormatter(RecordFormatter())
        self.setLevel(LEVELS[settings.level])
        self._trouble = trouble
        self._said = self._failed = False
        self._lost = 0  # records since one was last written

    def emit(self, record: logging.LogRecord) -> None:
        self._failed = False
        super().emit(record)
        if self._lost and not self._failed:
            lost, self._lost = self._lost, 0
            text = f"{lost} records before the last one could not be written and are missing"
            super().emit(logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, None, None))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - as the base class calls it
        self._failed = True
        self._lost += 1
        if self.stream is not None and self.stream.closed:
            self.stream = None  # it is opened again with the next record
        if not self._said:
            self._said = True
            error = sys.exc_info()[1]
            why = getattr(error, "strerror", None) or repr(error)
            self._trouble(f"{self.baseFilename} cannot be written ({why}): the flight goes on without it")

    def close(self) -> None:
        with suppress(OSError):
            super().close()

    def _open(self) -> io.TextIOWrapper:
        file = _WholeLines(self.baseFilename, "ab")
        return io.TextIOWrapper(file, encoding="utf-8", errors="backslashreplace", write_through=True)


class _WholeLines(io.FileIO):
    """Half a line would be glued to the next one when the disk has room again: what does not fit whole is not written."""

    def write(self, data: bytes, /) -> int:  # type: ignore[override]
        end, done = self.seek(0, io.SEEK_END), 0
        try:
            while done < len(data):
                done += super().write(data[done:])
        except OSError:
            with suppress(OSError):
                self.truncate(end)
            raise
        return done


class TerminalHandler(logging.Handler):
    """Tells the operator who asked for it (--verbose) what is logged, but not again what was said anyway."""

    def __init__(self, settings: LogSettings) -> None:
        super().__init__(LEVELS[settings.level])

    def emit(self, record: logging.LogRecord) -> None:
        if not getattr(record, "said", False):
            tell(line_of(record))


class RecordFormatter(logging.Formatter):
    """A record as it stands in flight.log, without the last line break."""

    def format(self, record: logging.LogRecord) -> str:
        traceback = self.formatException(record.exc_info) if record.exc_info and record.exc_info[0] else ""
        stack = record.stack_info or ""
        below = [f"{BAR}{masked(line)}" for text in (traceback, stack) if text for line in text.split("\n")]
        return "\n".join([line_of(record), *below])


def line_of(record: logging.LogRecord) -> str:
    """The record without its traceback, as one line that shows what cannot be printed."""
    head = f"{iso_utc(record.created)} {record.levelname} {record.threadName} {record.name}"
    return masked(f"{head}: {_message(record)}")


def masked(text: str) -> str:
    r"""`text` with escapes (\n, \x1b, \u202e) for all that breaks lines or cannot be seen, and without passwords of streams."""
    if "://" in text:
        text = _STREAM.sub(_without_password, text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def log_notice(logger: logging.Logger, notice: Notice) -> None:
    """Write down what the operator is told."""
    logger.log(LEVELS[notice.level], "%s: %s", notice.source, notice.text, extra={"said": True})


def tell(text: str) -> None:
    """A line on the terminal. One that has gone must not end the flight."""
    with suppress(OSError, ValueError):  # the second is how Python says that it is closed
        print(text, file=sys.stderr, flush=True)


def _message(record: logging.LogRecord) -> str:
    try:
        return record.getMessage()
    except (
        Exception
    ):  # the words do not fit their numbers, or one of them cannot be told: what can be is better than nothing
        return f"{_described(record.msg)} with {_described(record.args)}"


def _described(value: object) -> str:
    """As Python writes it, or of what type it is."""
    try:
        return repr(value)
    except Exception:
        if isinstance(value, tuple):
            return f"({', '.join(map(_described, value))})"
        return f"<{type(value).__name__}>"


def _without_password(found: re.Match[str]) -> str:
    scheme, host, rest = found.groups()
    return f"{scheme}://{host}{rest if _HARMLESS_PATH.fullmatch(rest) else '/…'}"
