"""Messages between the program and a worker process, each with a mass of bytes: a file, or the pixels of a picture."""

from __future__ import annotations

import os
import tempfile
from multiprocessing.connection import Connection

from gcs_mosaic.processes import pipe as pipes
from gcs_mosaic.processes.pipe import Message

KEPT_BYTES = 256 << 20  # of the shared file, between two pictures


class DecoderChannel:
    """One end. The masses go through a nameless file that both ends have open, so that a copy takes a few milliseconds and
    nothing is left behind whichever side is killed; through the pipe where there is no such file (Windows).

    Raises EOFError or OSError when the other end is gone.
    """

    def __init__(self, pipe: Connection, file: int | None) -> None:
        self._pipe, self._file = pipe, file

    def send(self, message: Message, mass: memoryview = memoryview(b"")) -> None:  # noqa: B008 - never changes
        """A message and, if not empty, flat bytes."""
        if self._file is not None and mass.nbytes:
            _write(self._file, mass)
        pipes.send(self._pipe, message)
        if self._file is None and mass.nbytes:
            self._pipe.send_bytes(mass)

    def receive(self) -> Message:
        """The next message; if it came with a mass, `fill` is next."""
        return pipes.receive(self._pipe)[0]

    def fill(self, mass: memoryview) -> None:
        """Flat bytes, as many as there is room for."""
        if self._file is None:
            if self._pipe.recv_bytes_into(mass) != mass.nbytes:
                raise OSError("fewer bytes than were said")
        else:
            _read(self._file, mass)

    def poll(self, timeout_s: float) -> bool:
        """Whether there is a message, or the other end is gone."""
        return self._pipe.poll(timeout_s)

    def close(self) -> None:
        self._pipe.close()
        close_file(self._file)
        self._file = None


def nameless_file() -> int | None:
    """A descriptor of a file in memory, or in the folder for temporary files; None where descriptors cannot be shared."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("decoded")
    if not hasattr(os, "pwritev") or not hasattr(os, "preadv"):
        return None
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def close_file(file: int | None) -> None:
    if file is not None:
        os.close(file)


def _write(file: int, mass: memoryview) -> None:
    if os.fstat(file).st_size > max(KEPT_BYTES, mass.nbytes):
        os.ftruncate(file, mass.nbytes)
    done = 0
    while done < mass.nbytes:
        done += os.pwritev(file, [mass[done:]], done)


def _read(file: int, mass: memoryview) -> None:
    done = 0
    while done < mass.nbytes:
        count = os.preadv(file, [mass[done:]], done)
        if not count:
            raise OSError("fewer bytes than were said")
        done += count
