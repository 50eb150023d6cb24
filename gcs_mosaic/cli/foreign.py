"""Commands that open a flight's folder, which somebody else may have written: whatever it holds, the answer is one sentence."""

from __future__ import annotations

import argparse
import logging
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.cli.streams import reader_has_gone
from gcs_mosaic.errors import FlightFailed, NothingPlaced, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.log import masked

logger = logging.getLogger(__name__)

OF_A_FLIGHT = frozenset({"serve", "status", "vehicle", "check", "anchor", "export", "merge", "integral"})
SAID = (UsageError, CannotWrite, FlightFailed, NothingPlaced)  # they are sentences already


@contextmanager
def telling_of_foreign(given: argparse.Namespace) -> Iterator[None]:
    """Turn what no check of ours has foreseen into a FlightFailed that tells where it was met."""
    try:
        with _lines_alone():
            yield
    except SAID:
        raise
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


def _named(given: argparse.Namespace) -> str:
    """The folder, or the folders, that the command was given."""
    folders = getattr(given, "flights", None) or [getattr(given, "flight", None) or "the folder"]
    return ", ".join(map(str, folders))
