"""flight.log: notices, refusals and exceptions of a flight, for diagnosis afterwards.

A record is a line: UTC, level, thread, logger, message; traceback lines follow, prefixed with a bar. With `format: json` a
record with its traceback is one JSON object on one line, for programs that collect logs. File names, texts from the link and
exception messages are untrusted: nothing in them can imitate another record.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Literal

from gcs_mosaic.messages import Notice
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.documents import iso_utc

BAR = "  | "  # before each line of a traceback
LEVELS = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

# User, password and host of a stream address, then the rest; paths may contain passwords too, and passwords quotes.
_STREAM = re.compile(r"(?i)\b(rtsps?)://(?:\S*@)?([^/\s'\"?#]*)(\S*)")
_HARMLESS_PATH = re.compile(r"[/\w.-]{0,80}['\"]?[])},;:]*", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSettings:
    """What flight.log contains."""

    # records below this level are omitted; debug also logs each accepted pair of frames
    level: Literal["debug", "info", "warning", "error"] = "info"
    # json: each record is one JSON object, also on the terminal's stream where nobody sits at it (journald, Loki)
    format: Literal["text", "json"] = "text"
    file_mb: int = 10  # size at which flight.log is rotated to flight.log.1
    files: int = 5  # how many are kept; the oldest is removed
    verbose: bool = False  # also log to the terminal (standard error), without tracebacks

    def __post_init__(self) -> None:
        if self.file_mb < 1:
            raise ValueError(f"file_mb: expected 1 or more, got {self.file_mb}")
        if self.files < 2:
            raise ValueError(f"files: expected 2 or more, of which one is being written, got {self.files}")


class LogFile(RotatingFileHandler):
    """Writes records to `path` and never raises. `trouble` is called once with the reason why a record could not be written."""

    def __init__(self, path: Path, settings: LogSettings, trouble: Callable[[str], None]) -> None:
        size, older = settings.file_mb * 1_000_000, settings.files - 1
        super().__init__(path, maxBytes=size, backupCount=older, encoding="utf-8", delay=True)
        self.setFormatter(formatter_of(settings))
        self.setLevel(LEVELS[settings.level])
        self._trouble = trouble
        self._said = self._failed = False
        self._lost = 0  # records since the last successful write

    def emit(self, record: logging.LogRecord) -> None:
        self._failed = False
        super().emit(record)
        if self._lost and not self._failed:
            lost, self._lost = self._lost, 0
            text = f"{lost} records before the last one could not be written and are missing"
            super().emit(logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, None, None))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - overrides the base class
        self._failed = True
        self._lost += 1
        if self.stream is not None and self.stream.closed:
            self.stream = None  # reopened with the next record
        if not self._said:
            self._said = True
            error = sys.exc_info()[1]
            why = getattr(error, "strerror", None) or repr(error)
            self._trouble(f"{self.baseFilename} cannot be written ({why}): the flight goes on without it")

    def shouldRollover(self, record: logging.LogRecord) -> bool:  # noqa: N802 - overrides the base class
        """Never by renaming a file at this path that is not ours."""
        stream = self.stream
        return bool(super().shouldRollover(record)) and (stream is None or is_at(stream.fileno(), self.baseFilename))

    def reopen(self) -> None:
        """Go on in the file at the path, after the folder was lost. It begins with what was written so far, if that can still be
        read; else it may be older."""
        self.acquire()
        try:
            old = self.stream
            if old is None or is_at(old.fileno(), self.baseFilename):
                return
            written = _written(old)
            if written:
                write_beside(Path(self.baseFilename), written)
            self.stream = self._open()
            with suppress(OSError):
                old.close()
        finally:
            self.release()

    def close(self) -> None:
        with suppress(OSError):
            super().close()

    def _open(self) -> io.TextIOWrapper:
        file = _WholeLines(self.baseFilename, "a+b")
        return io.TextIOWrapper(file, encoding="utf-8", errors="backslashreplace", write_through=True)


class _WholeLines(io.FileIO):
    """Never writes part of a line: the next one would be appended to it once the disk has space again."""

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


def is_at(descriptor: int, path: str | Path) -> bool:
    """Whether the open file is the one at this path."""
    try:
        return os.path.samestat(os.fstat(descriptor), Path(path).stat())
    except OSError:
        return False


def _written(stream: io.TextIOWrapper) -> bytes:
    """Everything in an open file, which may have no name any more."""
    try:
        with os.fdopen(os.dup(stream.fileno()), "rb") as file:
            file.seek(0)
            return file.read()
    except OSError:  # its disk is gone
        return b""


class TerminalHandler(logging.Handler):
    """Shows log records on the terminal (--verbose), except those already shown as notices."""

    def __init__(self, settings: LogSettings) -> None:
        super().__init__(LEVELS[settings.level])

    def emit(self, record: logging.LogRecord) -> None:
        if not getattr(record, "said", False):
            tell(line_of(record))


class JsonStream(logging.Handler):
    """Writes every record to standard error as JSON, what is said to the operator included."""

    def __init__(self, settings: LogSettings) -> None:
        super().__init__(LEVELS[settings.level])
        self.setFormatter(JsonFormatter())

    def emit(self, record: logging.LogRecord) -> None:
        tell(self.format(record))


class JsonFormatter(logging.Formatter):
    """A record as one JSON object in ASCII, without the final line break.

    utc, level, thread, logger, message; traceback if there is one; and the fields that were logged with it as
    `extra={"fields": {...}}`, such as frame, state, seconds.
    """

    def format(self, record: logging.LogRecord) -> str:
        told: dict[str, object] = {
            "utc": iso_utc(record.created),
            "level": record.levelname.lower(),
            "thread": record.threadName,
            "logger": record.name,
            "message": without_passwords(_message(record)),
        }
        traceback = self.formatException(record.exc_info) if record.exc_info and record.exc_info[0] else ""
        if below := "\n".join(text for text in (traceback, record.stack_info) if text):
            told["traceback"] = without_passwords(below)
        return _json_of(getattr(record, "fields", {}) | told)


def _json_of(told: dict[str, object]) -> str:
    """JSON on one line, in ASCII; what JSON cannot say is described."""
    try:
        return json.dumps(told, default=_described, allow_nan=False, separators=(",", ":"))
    except ValueError:  # NaN or infinity
        return json.dumps({key: value if isinstance(value, str) else _described(value) for key, value in told.items()})


def formatter_of(settings: LogSettings) -> logging.Formatter:
    """How the records of flight.log are written."""
    return JsonFormatter() if settings.format == "json" else RecordFormatter()


def streams_json(settings: LogSettings) -> bool:
    """Whether standard error is for a program, which is to get JSON and nothing else."""
    return settings.format == "json" and not (sys.stderr is not None and sys.stderr.isatty())


class RecordFormatter(logging.Formatter):
    """A record as in flight.log, without the final line break."""

    def format(self, record: logging.LogRecord) -> str:
        traceback = self.formatException(record.exc_info) if record.exc_info and record.exc_info[0] else ""
        stack = record.stack_info or ""
        below = [f"{BAR}{masked(line)}" for text in (traceback, stack) if text for line in text.split("\n")]
        return "\n".join([line_of(record), *below])


def line_of(record: logging.LogRecord) -> str:
    """The record without its traceback, as one line with unprintable characters escaped."""
    head = f"{iso_utc(record.created)} {record.levelname} {record.threadName} {record.name}"
    return masked(f"{head}: {_message(record)}")


def masked(text: str) -> str:
    r"""`text` with line breaks and invisible characters escaped (\n, \x1b, \u202e) and stream passwords masked."""
    text = without_passwords(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def without_passwords(text: str) -> str:
    """`text` with the passwords of stream addresses left out."""
    return _STREAM.sub(_without_password, text) if "://" in text else text


def log_notice(logger: logging.Logger, notice: Notice) -> None:
    """Log a notice shown to the operator."""
    logger.log(LEVELS[notice.level], "%s: %s", notice.source, notice.text, extra=said(source=notice.source))


def said(**fields: object) -> dict[str, object]:
    """`extra` of a record that the operator is shown otherwise; `fields` are for a log in JSON."""
    return {"said": True, "fields": fields}


def tell(text: str) -> None:
    """Print a line to the terminal. A closed terminal must not end the flight."""
    with suppress(OSError, ValueError):  # the second is raised by Python for a closed stream
        print(text, file=sys.stderr, flush=True)


def _message(record: logging.LogRecord) -> str:
    try:
        return record.getMessage()
    except Exception:  # format mismatch, or a value whose repr fails: log what can be described
        return f"{_described(record.msg)} with {_described(record.args)}"


def _described(value: object) -> str:
    """Its repr, or else its type."""
    try:
        return repr(value)
    except Exception:
        if isinstance(value, tuple):
            return f"({', '.join(map(_described, value))})"
        return f"<{type(value).__name__}>"


def _without_password(found: re.Match[str]) -> str:
    scheme, host, rest = found.groups()
    return f"{scheme}://{host}{rest if _HARMLESS_PATH.fullmatch(rest) else '/…'}"
