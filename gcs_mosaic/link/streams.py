"""Links that are streams of bytes (TCP, serial): opened again, with growing waits, whenever they are lost."""

from __future__ import annotations

import io
import select
import socket
import time
from collections.abc import Callable

from gcs_mosaic.events import Notice
from gcs_mosaic.link.address import LinkAddress
from gcs_mosaic.link.arrival import Arrival
from gcs_mosaic.link.ports import listen_tcp
from gcs_mosaic.link.settings import LinkSettings
from gcs_mosaic.link.wire import PacketReader

_CHUNK = 4096

Opener = Callable[[], io.RawIOBase | None]
"""Opens the stream; None if there is nobody yet, OSError if it cannot be opened now."""


class StreamChannel:
    """Reads a stream and opens it again when it is lost; both are said once, not at every try."""

    def __init__(self, name: str, opener: Opener, settings: LinkSettings) -> None:
        self.ended, self.working = False, True
        self._name, self._open, self._settings = name, opener, settings
        self._stream: io.RawIOBase | None = None
        self._reader = PacketReader(datagrams=False)
        self._trouble: str | None = None
        self._wait_s, self._next_try = settings.reconnect_first_s, 0.0

    @property
    def skipped_bytes(self) -> int:
        return self._reader.skipped_bytes

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        if self._stream is None:
            return self._reopened(timeout_s)
        if not select.select([self._stream], [], [], timeout_s)[0]:
            return []
        try:
            data = self._stream.read(_CHUNK)
        except OSError as error:
            return [self._lost(error.strerror or str(error))]
        if not data:
            return [self._lost("the other side has closed it")]
        received = time.monotonic()
        return [Arrival(message, received) for message in self._reader.feed(data)]

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
        self._reader = PacketReader(datagrams=False)
        self.working = True
        self._trouble, self._wait_s = None, self._settings.reconnect_first_s
        return [Notice(source=self._name, level="info", text=f"{self._name} is connected")]

    def _not_yet(self, reason: str) -> list[Arrival | Notice]:
        self.working = False
        self._next_try = time.monotonic() + self._wait_s
        self._wait_s = min(2 * self._wait_s, self._settings.reconnect_longest_s)
        if reason == self._trouble:
            return []
        self._trouble = reason
        text = f"{self._name} cannot be opened ({reason}); trying again until it can"
        return [Notice(source=self._name, level="warning", text=text)]

    def _lost(self, reason: str) -> Notice:
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        self.working = False
        self._next_try = time.monotonic() + self._settings.reconnect_first_s
        text = f"{self._name} is lost ({reason}); opening it again"
        return Notice(source=self._name, level="warning", text=text)


def tcp_client(address: LinkAddress, settings: LinkSettings) -> Opener:
    """Connects to the address."""

    def connect() -> io.RawIOBase:
        where = (address.host, address.port)
        with socket.create_connection(where, timeout=settings.connect_timeout_s) as connection:
            return connection.makefile("rb", buffering=0)  # keeps the connection open after the socket object is gone

    return connect


class TcpServer:
    """Takes one caller at a time; the port is taken at once, so that a wrong one is known at the start."""

    def __init__(self, address: LinkAddress, settings: LinkSettings) -> None:
        self._listener = listen_tcp(address.host, address.port, settings.receive_buffer_bytes)
        self._listener.settimeout(settings.poll_s)

    def __call__(self) -> io.RawIOBase | None:
        try:
            connection, _ = self._listener.accept()
        except TimeoutError:
            return None
        with connection:
            return connection.makefile("rb", buffering=0)

    def close(self) -> None:
        self._listener.close()


def serial(address: LinkAddress) -> Opener:
    """Opens the serial device."""

    def open_device() -> io.RawIOBase:
        from gcs_mosaic.link.serial_port import open_serial  # not every system has terminals

        return open_serial(address.device, address.baud)

    return open_device
