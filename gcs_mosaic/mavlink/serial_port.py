"""A serial device (POSIX), opened read-only unless we are to send."""

from __future__ import annotations

import errno
import io
import os

from gcs_mosaic.errors import UsageError

_SPEED_AT = (4, 5)  # where tcgetattr keeps the input and the output speed


def require_termios(device: str) -> None:
    """Raises UsageError where the system has no termios (Windows), naming what to do instead."""
    try:
        import fcntl  # noqa: F401
        import termios  # noqa: F401
    except ImportError:
        raise UsageError(
            f"--mavlink {device!r} is a serial device, which this system cannot open (it needs termios, as on Linux and macOS): "
            f"let a program that can forward it to UDP, such as mavproxy --master={device} --out=udpout:127.0.0.1:14445, "
            "and give --mavlink udp:14445."
        ) from None


def open_serial(device: str, baud: int, *, writing: bool = False) -> io.RawIOBase:
    """The raw bytes of `device` at `baud` bits per second.

    Raises OSError if the device is missing, not readable by us, not a terminal, or held by another program (two readers
    of one serial line would each get half of the bytes); UsageError on a system without termios.
    """
    require_termios(device)
    import fcntl
    import termios

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
    import termios
    import tty

    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise OSError(errno.EINVAL, f"{baud} bits per second is no speed of this system; 57600 and 115200 are")
    tty.setraw(descriptor)
    attributes = termios.tcgetattr(descriptor)
    for index in _SPEED_AT:
        attributes[index] = speed
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
