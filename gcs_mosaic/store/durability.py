"""Periodic syncs that limit the ledger's loss in a power cut to one second."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

logger = logging.getLogger(__name__)

EACH_S = 0.5  # with the disk's own latency, less than a second


class Durability:
    """Calls `make_durable` twice a second on its own thread until `close`. A failure is logged once and retried."""

    def __init__(self, make_durable: Callable[[], None]) -> None:
        self._make_durable = make_durable
        self._ended = threading.Event()
        self._fails = False
        self._began: float | None = None
        self._took_s = 0.0
        self._thread = threading.Thread(target=self._run, name="durability", daemon=True)
        self._thread.start()

    @property
    def takes_s(self) -> float:
        """How long a sync takes: the last one, or the one under way if that is longer already."""
        began = self._began
        return max(self._took_s, 0.0 if began is None else time.monotonic() - began)

    def close(self) -> None:
        """Call it once more, then stop."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(EACH_S):
            self._try()
        self._try()

    def _try(self) -> None:
        began = self._began = time.monotonic()
        try:
            self._make_durable()
            self._fails = False
        except Exception:
            if not self._fails:
                logger.warning("the ledger cannot be brought to the disk", exc_info=True)
            self._fails = True
        finally:
            self._took_s, self._began = time.monotonic() - began, None
