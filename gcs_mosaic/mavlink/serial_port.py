"""A serial device, opened for reading only unless we are to send (POSIX)."""

from __future__ import annotations

import errno
import fcntl
import io
import os
import termios
import tty

_SPEED_AT = (4, 5)  # where tcgetattr keeps the input and the output speed


def open_serial(device: str, baud: int, *, writing: bool = False) -> io.RawIOBase:
    """The raw bytes of `device` at `baud` bits per second.

    Raises OSError if it is not there, not ours to read, not a terminal, or held by another program: two readers of
    one serial line would each get half of the bytes.
    """
    descriptor = os.open(device, (os.O_RDWR if writing else os.O_RDONLY) | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
        _make_raw(descriptor, baud)
    except BlockingIOError as error:
        os.close(descriptor)
        raise OSError(errno.EBUSY, "another program has it open") from error
    except termios.error as error:
        os.close(descriptor)
        raise OSError(errno.ENOTTY, "it is not a serial device") from error
    except OSError:
        os.close(descriptor)
        raise
    return io.FileIO(descriptor, "r+b" if writing else "rb")


def _make_raw(descriptor: int, baud: int) -> None:
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise OSError(errno.EINVAL, f"{baud} bits per second is no speed of this system; 57600 and 115200 are")
    tty.setraw(descriptor)
    attributes = termios.tcgetattr(descriptor)
    for index in _SPEED_AT:
        attributes[index] = speed
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
