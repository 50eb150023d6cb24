"""A process of our own that works with foreign data, and our end of its pipe."""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import signal
from collections.abc import Callable
from typing import Any

from gcs_mosaic.children import starting

logger = logging.getLogger(__name__)

GRACE_S = 2.0  # for it to end by itself


class ChildProcess:
    """Runs `target(pipe, *given)`; it ends when its pipe is closed, and with the program. Raises OSError if it cannot start."""

    def __init__(self, name: str, target: Callable[..., None], *given: Any) -> None:
        context = multiprocessing.get_context("spawn")  # threads are running: a fork could inherit their locks
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=target, args=(theirs, *given), name=name, daemon=True)
        try:
            with starting():
                self._process.start()
        except BaseException:
            self.pipe.close()
            raise
        finally:
            theirs.close()
        atexit.register(self._process.kill)  # it does not end on a signal that is for the program

    def end(self) -> str:
        """Have it end; returns how it has."""
        atexit.unregister(self._process.kill)
        self.pipe.close()
        self._process.join(GRACE_S)
        self._process.kill()
        self._process.join()
        code = self._process.exitcode or 0
        self._process.close()
        return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
