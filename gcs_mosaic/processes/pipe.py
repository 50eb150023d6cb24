"""Messages from a child process: JSON, and a mass of bytes with each that has one.

A process that a foreign picture or stream has taken over can send what is wrong, but nothing that is executed. What the program
sends to a child is trusted, and pickled (`Connection.send`).
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

logger = logging.getLogger(__name__)

Message = dict[str, Any]

END = b"\0"  # of a message's JSON, which has no such byte; the mass is behind it
MOST_BYTES = 1 << 29  # of a message


def send(pipe: Connection, message: Message, mass: bytes = b"") -> None:
    """Raises OSError when the other end is gone."""
    pipe.send_bytes(json.dumps(message).encode() + END + mass)


def receive(pipe: Connection) -> tuple[Message, bytes]:
    """Waits for the next one. Raises EOFError and OSError when the other end is gone, and OSError for what is no message."""
    text, _, mass = pipe.recv_bytes(MOST_BYTES).partition(END)
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise OSError("no message of ours") from error
    if not isinstance(message, dict):
        raise OSError("no message of ours")
    return message, mass


def messages(pipe: Connection, wait_s: float) -> Iterator[tuple[Message, bytes]]:
    """What has come within the time; raises as `receive`."""
    while pipe.poll(wait_s):
        yield receive(pipe)
        wait_s = 0.0


class ChildTeller:
    """A child's voice, from any of its threads."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._one_at_a_time = threading.Lock()

    def send(self, message: Message, mass: bytes = b"") -> None:
        """Raises OSError when the program has ended."""
        with self._one_at_a_time:
            send(self._pipe, message, mass)

    def tell(self, **told: object) -> None:
        """As `send`, where somebody else finds out that the program has ended."""
        with suppress(OSError):
            self.send(told)

    def log(self, text: str, level: int) -> None:
        """For the program's log; see `was_logged`."""
        self.tell(log=[level, text])


class TellingHandler(logging.Handler):
    """Passes log records on to the program."""

    def __init__(self, teller: ChildTeller) -> None:
        super().__init__()
        self._teller = teller

    def emit(self, record: logging.LogRecord) -> None:
        self._teller.log(self.format(record), record.levelno)


def was_logged(message: Message, what: str) -> bool:
    """Whether this was a log record of a child, `what`, which is in our log then. Raises OSError for an odd one."""
    if "log" not in message:
        return False
    try:
        level, text = message["log"]
        logger.log(int(level), "%s: %s", what, text)
    except (TypeError, ValueError, OverflowError) as error:
        raise OSError("no message of ours") from error
    return True
