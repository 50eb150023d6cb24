"""flight.log for the duration of a flight, including everything unexpected."""

from __future__ import annotations

import importlib.metadata
import logging
import platform
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gcs_mosaic.config.tree import Config, changed, shareable
from gcs_mosaic.errors import FlightFailed, NothingPlaced, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import LEDGER_NAME, LOG_NAME, FlightFolder
from gcs_mosaic.store.log import LEVELS, JsonStream, LogFile, TerminalHandler, masked, streams_json, tell

logger = logging.getLogger(__name__)

PACKAGE = "gcs_mosaic"


@contextmanager
def flight_log(folder: FlightFolder, config: Config) -> Iterator[LogFile]:
    """Keep flight.log in the folder while the body runs. Unexpected exceptions are logged there and become FlightFailed."""
    path = folder.path / LOG_NAME
    file = LogFile(path, config.log, _log if streams_json(config.log) else _tell)
    handlers: list[logging.Handler] = [file]
    if streams_json(config.log):
        handlers.append(JsonStream(config.log))
    elif config.log.verbose:
        handlers.append(TerminalHandler(config.log))
    try:
        with (
            _listening(handlers, LEVELS[config.log.level]),
            _catching(_say_nothing if streams_json(config.log) else _tell),
        ):
            _introduce(config)
            with _written_down(path):
                yield file
    except (UsageError, CannotWrite):
        if not (folder.path / LEDGER_NAME).exists():
            path.unlink(missing_ok=True)  # a flight that never began leaves nothing behind
        raise


@contextmanager
def _written_down(path: Path) -> Iterator[None]:
    """Log how the flight ends."""
    try:
        yield
    except (UsageError, CannotWrite, NothingPlaced) as error:
        logger.error("%s", error, exc_info=True, extra={"said": True})
        raise
    except Exception as error:
        logger.exception("the flight has failed")
        raise FlightFailed(f"a fault of the program has ended the flight ({error!r}); {path} tells where") from error
    except BaseException as error:
        logger.warning("the flight is interrupted (%r)", error)
        raise
    logger.info("the flight has ended")


@contextmanager
def _listening(handlers: list[logging.Handler], level: int) -> Iterator[None]:
    """Route all records to the handlers: our own from `level` up, those of libraries from warning up."""
    root, ours = logging.getLogger(), logging.getLogger(PACKAGE)
    before = ours.level
    ours.setLevel(level)
    for handler in handlers:
        root.addHandler(handler)
    try:
        yield
    finally:
        ours.setLevel(before)
        for handler in handlers:
            root.removeHandler(handler)
            handler.close()


@contextmanager
def _catching(say: Callable[[str], None]) -> Iterator[None]:
    """Log what Python would print on the terminal: exceptions in threads and finalisers, warnings."""
    before = threading.excepthook, sys.unraisablehook, logging.raiseExceptions
    died = partial(_thread_died, say)
    threading.excepthook, sys.unraisablehook, logging.raiseExceptions = died, _thrown_away, False
    logging.captureWarnings(True)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        threading.excepthook, sys.unraisablehook, logging.raiseExceptions = before


def _thread_died(say: Callable[[str], None], died: threading.ExceptHookArgs) -> None:
    if died.exc_type is SystemExit:
        return
    name = died.thread.name if died.thread else "?"
    logger.critical("the thread %s has died", name, exc_info=died.exc_value, extra={"said": True})
    say(f"a part of the program has died ({name}: {died.exc_value!r}), {LOG_NAME} tells where; start gcs-mosaic again")


def _thrown_away(thrown: Any) -> None:
    logger.error(
        "%s %r",
        thrown.err_msg or "an exception that could be raised to nobody, in",
        thrown.object,
        exc_info=thrown.exc_value,
    )


def _tell(text: str) -> None:
    tell(masked(f"gcs-mosaic: {text}"))


def _log(text: str) -> None:
    logger.error("%s", text)


def _say_nothing(text: str) -> None:
    """It is in the log, which is what is shown."""


def _introduce(config: Config) -> None:
    versions = f"Python {platform.python_version()}, OpenCV {cv2.__version__}, numpy {np.__version__}"
    logger.info("gcs-mosaic %s, %s, %s", _version(), versions, platform.platform())
    logger.info("settings that are not the defaults: %s", ", ".join(changed(shareable(config))) or "none")


def _version() -> str:
    try:
        return importlib.metadata.version("gcs-mosaic")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"
