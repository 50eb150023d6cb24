"""Commands that open a flight's folder, which somebody else may have written: whatever it holds, the answer is one sentence."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.cli.streams import reader_has_gone
from gcs_mosaic.errors import FlightFailed, NothingPlaced, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.log import masked

logger = logging.getLogger(__name__)

OF_A_FLIGHT = frozenset({"serve", "status", "vehicle", "check", "anchor", "export", "merge", "integral", "pair"})
SAID = (UsageError, CannotWrite, FlightFailed, NothingPlaced)  # they are sentences already


@contextmanager
def telling_of_foreign(given: argparse.Namespace) -> Iterator[None]:
    """Turn what no check of ours has foreseen into a FlightFailed that tells where it was met."""
    try:
        _refuse_unreadable(_folders(given))
        with _lines_alone():
            yield
    except SAID:
        raise
    except PermissionError as error:
        logger.debug("%s cannot be read", given, exc_info=True)
        text = (
            f"{error.filename or _named(given)} cannot be opened ({error.strerror}): do it as the user who wrote the flight; "
            "with permissions: group (or all) in the settings other users can read those to come"
        )
        raise FlightFailed(text) from error
    except Exception as error:
        if isinstance(error, BrokenPipeError) and reader_has_gone():
            raise
        logger.debug("%s cannot be read", given, exc_info=True)
        met = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{error!r:.200}, {Path(met.filename).name}:{met.lineno}"
        text = f"{_named(given)} holds what gcs-mosaic {given.command} cannot use ({what}): see gcs-mosaic check"
        raise FlightFailed(text) from error


@contextmanager
def _lines_alone() -> Iterator[None]:
    """What is logged where nothing keeps a log goes to the terminal as one line, without a traceback."""
    terminal = logging.lastResort
    if terminal is None:
        yield
        return
    before = terminal.formatter
    terminal.setFormatter(_Line())
    try:
        yield
    finally:
        terminal.setFormatter(before)


class _Line(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        error = record.exc_info[1] if record.exc_info else None
        return masked(f"gcs-mosaic: {record.getMessage()}{f' ({error})' if error else ''}")


def _refuse_unreadable(folders: Sequence[Path]) -> None:
    """Raises PermissionError for a flight of another user, also if its folder is open to all: else each part would be told as
    damaged in its own way."""
    for path in (folder / name for folder in folders for name in (LEDGER_NAME, "mosaic.json")):
        if path.is_file() and not os.access(path, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def _folders(given: argparse.Namespace) -> list[Path]:
    """Those that the command was given."""
    one = getattr(given, "flight", None)
    return [Path(folder) for folder in getattr(given, "flights", None) or ([one] if one else [])]


def _named(given: argparse.Namespace) -> str:
    return ", ".join(map(str, _folders(given))) or "the folder"
