"""Tells systemd how the daemon is: ready, what it does, that it turns, that it is ending (sd_notify, without its library).

Does nothing where no service manager asks for it: `NOTIFY_SOCKET` is only set under `Type=notify`.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Mapping

logger = logging.getLogger(__name__)

STATUS_EACH_S = 2.0
ENDING_S = 60.0  # asked for again and again while the flight is being ended
LONGEST_END_STEP_S = 1200.0  # of one step of ending: the adjustment of everything takes 15 minutes at most


class ServiceManager:
    """Where systemd listens, by the environment it has given; a failure to tell it is logged once."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # A name that begins with @ is in the abstract namespace, which the kernel spells with a zero byte.
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        family = getattr(socket, "AF_UNIX", None)
        self._socket = socket.socket(family, socket.SOCK_DGRAM) if address and family is not None else None
        self._alive_each_s = _watchdog_s(environment) / 4  # systemd advises half; a late one must not end a flight
        self._ending = self._failed = False
        self._said_alive = self._said_status = float("-inf")
        if self._socket is not None:
            self._socket.setblocking(False)

    def ready(self) -> None:
        """The links are open, the folder is locked, the first turn of the main loop begins."""
        self._tell("READY=1")

    def alive(self) -> None:
        """The main loop turns; call at each turn."""
        now = time.monotonic()
        if self._socket is None or now - self._said_alive < self._alive_each_s:
            return
        self._said_alive = now
        self._tell("WATCHDOG=1", *([f"EXTEND_TIMEOUT_USEC={_usec(ENDING_S)}"] if self._ending else []))

    def status(self, text: str) -> None:
        """What `systemctl status` shows, in one line; call as often as you like."""
        now = time.monotonic()
        if self._socket is not None and now - self._said_status >= STATUS_EACH_S:
            self._said_status = now
            self._tell(f"STATUS={text}".replace("\n", " "))

    def ending(self) -> None:
        """The final map is being painted, which may take its time: not to be killed as long as `alive` is called."""
        self._ending, self._said_alive = True, float("-inf")
        longer = [f"WATCHDOG_USEC={_usec(LONGEST_END_STEP_S)}"] if self._alive_each_s else []
        self._tell("STOPPING=1", *longer)
        self.alive()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, *lines: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(lines).encode(), self._address)
        except OSError:
            if not self._failed:
                logger.warning("the service manager cannot be told", exc_info=True)
            self._failed = True


def _watchdog_s(environment: Mapping[str, str]) -> float:
    """How long the main loop may be silent before it is taken for hung; 0 if nobody watches."""
    asked, of = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
    ours = not of or of == str(os.getpid())
    return int(asked) / 1e6 if asked.isascii() and asked.isdecimal() and ours else 0.0


def _usec(seconds: float) -> int:
    return round(seconds * 1e6)
