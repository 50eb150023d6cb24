"""Ports for programs that are told theirs before they are started; whatever can bind 0 and be asked, does that."""

import os
import random
import re
import socket

# Below those that the kernel gives to whoever binds 0, so that no socket is given one of these by chance.
FIRST, END, WORKERS = 20_000, 32_000, 32
_worker = int(re.sub(r"\D", "", os.environ.get("PYTEST_XDIST_WORKER", "")) or 0) % WORKERS
_mine = range(FIRST + _worker, END, WORKERS)
_left = iter(random.SystemRandom().sample(_mine, len(_mine)))


def free_port() -> int:
    """One that nobody has, for UDP or TCP, and that has not been given in this process; each worker of a run has its own."""
    return next(port for port in _left if is_free(port))


def is_free(port: int) -> bool:
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return False
    return True
