"""Where messages come from: one receive-only reader for each kind of address. None of them ever sends."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import Protocol

from gcs_mosaic.events import Notice
from gcs_mosaic.link import streams, tlog
from gcs_mosaic.link.address import LinkAddress, connection_string
from gcs_mosaic.link.arrival import Arrival
from gcs_mosaic.link.ports import bind_udp
from gcs_mosaic.link.settings import LinkSettings
from gcs_mosaic.link.wire import PacketReader

_LARGEST_DATAGRAM = 65535
_MOST_PEERS = 32  # senders whose unfinished packets are kept; the one that was silent longest is forgotten


class Channel(Protocol):
    """A source of messages."""

    ended: bool
    """There can be no more."""
    working: bool
    """False while it cannot be opened."""

    @property
    def skipped_bytes(self) -> int:
        """How many bytes have come that were no MAVLink."""

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        """What has come, after at most about `timeout_s`; empty if nothing has."""

    def close(self) -> None:
        """Give the port, device or file back."""


def open_channel(address: LinkAddress, settings: LinkSettings) -> Channel:
    """The channel at `address`. Raises UsageError for a port that is taken or a file that is not there."""
    match address.kind:
        case "udp":
            return UdpChannel(address, settings)
        case "tcp":
            return streams.StreamChannel(connection_string(address), streams.tcp_client(address, settings), settings)
        case "tcpin":
            return streams.StreamChannel(connection_string(address), streams.TcpServer(address, settings), settings)
        case "serial":
            return streams.StreamChannel(connection_string(address), streams.serial(address), settings)
        case "file":
            return tlog.TlogChannel(address)


class UdpChannel:
    """Listens on a UDP port that nobody else holds. Senders are kept apart, so that none can damage another's bytes."""

    def __init__(self, address: LinkAddress, settings: LinkSettings) -> None:
        self.ended, self.working = False, True
        self._socket = bind_udp(address.host, address.port, settings.receive_buffer_bytes)
        self._readers: OrderedDict[tuple[str, int], PacketReader] = OrderedDict()

    @property
    def skipped_bytes(self) -> int:
        return sum(reader.skipped_bytes for reader in self._readers.values())

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        self._socket.settimeout(timeout_s)
        try:
            data, peer = self._socket.recvfrom(_LARGEST_DATAGRAM)
        except (TimeoutError, ConnectionError):  # Windows reports another's closed port here
            return []
        received = time.monotonic()
        return [Arrival(message, received) for message in self._reader(peer).feed(data)]

    def close(self) -> None:
        self._socket.close()

    def _reader(self, peer: tuple[str, int]) -> PacketReader:
        reader = self._readers.setdefault(peer, PacketReader(datagrams=True))
        self._readers.move_to_end(peer)
        if len(self._readers) > _MOST_PEERS:
            self._readers.popitem(last=False)
        return reader
