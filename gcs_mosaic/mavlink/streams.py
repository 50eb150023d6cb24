"""Byte-stream links (TCP, serial), reopened with exponential back-off when lost."""

from __future__ import annotations

import io
import logging
import select
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Literal

from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import PacketReader
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.serial_port import open_serial, require_termios
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.sockets import listen_tcp
from gcs_mosaic.messages import Notice

logger = logging.getLogger(__name__)

STALLED_S = 1.0  # a read this much later than it should have returned

_CHUNK = 4096
_MOST_HELD = 1 << 22  # bytes of a pause that are read at once; more than the kernel holds
_KEEPALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}  # s, s, probes: a dead peer is found after 25 s

# Of bytes that are not MAVLink: each 128 of them cost the check of a packet, and a peer can send without end. Serial lines bring
# up to 300 kB/s; what comes faster waits in the kernel.
_NOISE_PER_S, _NOISE_AT_ONCE, _LONGEST_PAUSE_S = 400_000, 1 << 20, 0.05

_SILENT_S = 5.0  # five heartbeats: after that another client takes a server's place

Mode = Literal["rb", "rwb"]
Opener = Callable[[], io.RawIOBase | None]
"""Opens the stream; None without a peer yet, OSError if it cannot be opened now."""


class NoisePace:
    """How long to leave a stream alone, by the noise that it has brought: a leaky bucket."""

    def __init__(self, now: float) -> None:
        self._held, self._at, self._known = 0.0, now, 0

    def pause_s(self, skipped_bytes: int, now: float) -> float:
        """Seconds to wait before the next read; 0 for a stream without much noise."""
        held = max(0.0, self._held - (now - self._at) * _NOISE_PER_S) + skipped_bytes - self._known
        self._held = min(held, 2.0 * _NOISE_AT_ONCE)  # a pause of the program may have held more
        self._at, self._known = now, skipped_bytes
        return min(max(0.0, self._held - _NOISE_AT_ONCE) / _NOISE_PER_S, _LONGEST_PAUSE_S)


class StreamChannel:
    """Reads a stream and reopens it when lost; each is reported once, not at every try.

    Only a stream that has delivered data counts as working: the back-off also grows where a peer accepts and hangs up, or a
    device opens and fails.
    """

    def __init__(
        self, name: str, opener: Opener, settings: LinkSettings, admits: Callable[[bytes], bool] | None = None
    ) -> None:
        self.ended, self.working = False, True
        self._name, self._open, self._settings = name, opener, settings
        self._stream: io.RawIOBase | None = None
        self._admits = admits
        self._reader = PacketReader(datagrams=False, admits=admits)
        self._unsent = b""  # the rest of a partly written packet
        self._trouble: str | None = None  # the last one reported
        self._brought, self._hangs_up = False, False  # this connection delivered data; the previous one did not
        self._skipped_before = 0  # bytes, on earlier connections
        self._looked = time.monotonic()  # when it was last seen whether there is anything to read
        self._heard = self._looked  # the last message, or the connection itself
        self._wait_s, self._next_try = settings.reconnect_first_s, 0.0
        self._pace = NoisePace(self._looked)

    @property
    def skipped_bytes(self) -> int:
        return self._skipped_before + self._reader.skipped_bytes

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        if self._stream is None:
            return self._reopened(timeout_s)
        if isinstance(self._open, TcpServer) and self._open.is_called() and self._is_silent():
            return self._lost("nothing has come from it, and another calls")
        time.sleep(self._pace.pause_s(self.skipped_bytes, time.monotonic()))
        ready = select.select([self._stream], [], [], timeout_s)[0]
        looked, self._looked = self._looked, time.monotonic()
        if not ready:
            return []
        stalled = self._looked - looked > timeout_s + STALLED_S
        try:
            data = self._held_up(self._stream) if stalled else self._stream.read(_CHUNK)
        except OSError as error:
            return self._lost(error.strerror or str(error))
        if not data:
            return self._lost("the other side has closed it")
        messages = self._reader.feed(data)
        if messages:
            self._heard = self._looked
        if stalled:
            return [*self._works(), *spread(messages, len(data), looked, self._looked)]
        return [*self._works(), *(Arrival(message, self._looked) for message in messages)]

    def _held_up(self, stream: io.RawIOBase) -> bytes:
        """All that the kernel held while nobody read. What ends the stream after some data is left to the next read."""
        data = bytearray()
        while len(data) < _MOST_HELD and select.select([stream], [], [], 0.0)[0]:
            try:
                chunk = stream.read(_CHUNK)
            except OSError:
                if not data:
                    raise
                break
            if not chunk:
                break
            data += chunk
        return bytes(data)

    def send(self, packet: bytes) -> bool:
        if self._unsent:  # finish the partly written packet first
            self._unsent = self._unsent[self._written(self._unsent) :]
        if self._unsent:
            return False
        written = self._written(packet)
        self._unsent = packet[written:] if written else b""
        return written > 0

    def _written(self, data: bytes) -> int:
        """Write without blocking; returns the number of bytes accepted."""
        if self._stream is None:
            return 0
        try:
            ready = select.select([], [self._stream], [], 0.0)[1]
            return (self._stream.write(data) or 0) if ready else 0
        except OSError:  # the next read reports the cause
            logger.debug("nothing can be sent", exc_info=True)
            return 0

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        if isinstance(self._open, TcpServer):
            self._open.close()

    def _reopened(self, timeout_s: float) -> list[Arrival | Notice]:
        wait = self._next_try - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout_s))
            return []
        try:
            self._stream = self._open()
        except OSError as error:
            return self._not_yet(error.strerror or str(error))
        if self._stream is None:
            return []
        self._skipped_before += self._reader.skipped_bytes
        self._reader, self._unsent = PacketReader(datagrams=False, admits=self._admits), b""
        self.working, self._brought, self._looked = True, False, time.monotonic()
        self._heard = self._looked
        return [] if self._hangs_up else [self._connected()]

    def _is_silent(self) -> bool:
        return time.monotonic() - self._heard > _SILENT_S

    def _works(self) -> list[Arrival | Notice]:
        """Data has arrived: reset the back-off and report the connection if that is still due."""
        news = [self._connected()] if self._hangs_up else []
        self._brought, self._hangs_up = True, False
        self._trouble, self._wait_s = None, self._settings.reconnect_first_s
        return [*news]

    def _connected(self) -> Notice:
        return Notice(source=self._name, level="info", text=f"{self._name} is connected")

    def _not_yet(self, reason: str) -> list[Arrival | Notice]:
        return self._later(f"{self._name} cannot be opened ({reason}); trying again until it can")

    def _lost(self, reason: str) -> list[Arrival | Notice]:
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        self._hangs_up = not self._brought
        return self._later(f"{self._name} is lost ({reason}); opening it again")

    def _later(self, trouble: str) -> list[Arrival | Notice]:
        """Schedule the next attempt; `trouble` is reported if it differs from the last one."""
        self.working = False
        self._next_try = time.monotonic() + self._wait_s
        self._wait_s = min(2 * self._wait_s, self._settings.reconnect_longest_s)
        if trouble == self._trouble:
            return []
        self._trouble = trouble
        return [Notice(source=self._name, level="warning", text=trouble)]


def opener(address: LinkAddress, settings: LinkSettings) -> Opener:
    """The opener of a TCP or serial address: read-only, unless we are to announce ourselves."""
    mode: Mode = "rb" if settings.announce is None else "rwb"
    match address.kind:
        case "tcp":
            return tcp_client(address, settings, mode)
        case "tcpin":
            return TcpServer(address, settings, mode)
        case _:
            return serial(address, mode)


def tcp_client(address: LinkAddress, settings: LinkSettings, mode: Mode = "rb") -> Opener:
    """Connects to the address."""

    def connect() -> io.RawIOBase:
        where = (address.host, address.port)
        with socket.create_connection(where, timeout=settings.connect_timeout_s) as connection:
            notice_when_gone(connection)
            return connection.makefile(mode, buffering=0)  # keeps the connection open after the socket object is closed

    return connect


def notice_when_gone(connection: socket.socket) -> None:
    """Enable TCP keep-alive: a receiver that never sends would not notice that the peer was switched off."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE.items():
        if option := getattr(socket, name, None):  # not every system has all of them
            connection.setsockopt(socket.IPPROTO_TCP, option, value)


class TcpServer:
    """Accepts one client at a time, another once that one is silent; binds the port at once: an unusable one is told early."""

    def __init__(self, address: LinkAddress, settings: LinkSettings, mode: Mode = "rb") -> None:
        self._mode: Mode = mode
        self._listener = listen_tcp(address.host, address.port, settings.receive_buffer_bytes)
        self._listener.settimeout(settings.poll_s)

    def __call__(self) -> io.RawIOBase | None:
        try:
            connection, _ = self._listener.accept()
        except TimeoutError:
            return None
        with connection:
            notice_when_gone(connection)
            return connection.makefile(self._mode, buffering=0)

    def is_called(self) -> bool:
        """Whether another client waits."""
        return bool(select.select([self._listener], [], [], 0.0)[0])

    def close(self) -> None:
        self._listener.close()


def serial(address: LinkAddress, mode: Mode = "rb") -> Opener:
    """Opens the serial device. Raises UsageError at once on a system without termios."""
    require_termios(address.device)

    def open_device() -> io.RawIOBase:
        return open_serial(address.device, address.baud, writing=mode == "rwb")

    return open_device


def spread(messages: Iterable[MavMessage], size: int, start: float, end: float) -> Iterator[Arrival]:
    """The messages in `size` bytes that were all read at `end`, after the program had stood still since `start` (a suspended
    laptop, SIGSTOP), dated at an even rate in between.

    The kernel tells no receive times here, but telemetry comes evenly. That dates messages without a time of their own;
    senders' clocks must not learn from it, so it is marked as an estimate (`latest`).
    """
    position = 0
    for message in messages:
        position += len(message.get_msgbuf())
        yield Arrival(message, start + (end - start) * min(position / size, 1.0), latest=end)
