"""Keeps the ledger at most a second behind what was written into it, should the power be cut."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

logger = logging.getLogger(__name__)

EACH_S = 0.5  # so that with the disk's own time it is less than a second


class Durability:
    """Calls `make_durable` twice a second, from a thread of its own, until `close`. What fails is logged once, tried again."""

    def __init__(self, make_durable: Callable[[], None]) -> None:
        self._make_durable = make_durable
        self._ended = threading.Event()
        self._fails = False
        self._thread = threading.Thread(target=self._run, name="durability", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Once more, then no longer."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(EACH_S):
            self._try()
        self._try()

    def _try(self) -> None:
        try:
            self._make_durable()
            self._fails = False
        except Exception:
            if not self._fails:
                logger.warning("the ledger cannot be brought to the disk", exc_info=True)
            self._fails = True
