"""Transports: one channel class per kind of address. They send only what they are given, which is nothing without a
`Speaker`."""

from __future__ import annotations

import logging
import math
import socket
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink import streams, tlog
from gcs_mosaic.mavlink.address import LinkAddress, connection_string, host_and_port
from gcs_mosaic.mavlink.datagrams import DatagramReader
from gcs_mosaic.mavlink.parser import PacketReader
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing
from gcs_mosaic.mavlink.sockets import bind_udp, family_of
from gcs_mosaic.messages import Notice

logger = logging.getLogger(__name__)

_MOST_PEERS = 32  # senders whose partial packets are kept; the one silent longest is evicted
_PEER_GONE_S = 10.0  # nothing is sent to a peer that has missed ten heartbeats

Admits = Callable[[bytes], bool]
Skips = Callable[[str, bytes, float], bool]
"""Whether to drop a datagram undecoded, by its sender, content and arrival: decoding a flood costs more than receiving it."""


class Channel(Protocol):
    """A source of messages."""

    ended: bool
    """The source is exhausted."""
    working: bool
    """False while it cannot be opened."""

    @property
    def skipped_bytes(self) -> int:
        """Number of received bytes that were not MAVLink."""

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        """Messages and notices received within about `timeout_s`; empty if there were none."""

    def send(self, packet: bytes) -> bool:
        """Send `packet` to the known peers; whether it was sent. Never blocks."""

    def close(self) -> None:
        """Release the port, device or file."""


def open_channel(address: LinkAddress, settings: LinkSettings, signing: Signing | None = None) -> Channel:
    """The channel at `address`; packets that `signing` does not admit are dropped.

    Raises UsageError for a port in use, a missing file, a serial device on a system without termios, or an outgoing address
    without `announce`.
    """
    admits = signing.admits if signing else None
    match address.kind:
        case "udp":
            return UdpChannel(address, settings, admits)
        case "udpout":
            return CallingChannel(address, settings, admits)
        case "tcp" | "tcpin" | "serial":
            opener = streams.opener(address, settings)
            return streams.StreamChannel(connection_string(address), opener, settings, admits)
        case "file":
            return tlog.TlogChannel(address)


@dataclass(slots=True)
class _Peer:
    """A sender, and when its last admitted packet arrived."""

    reader: PacketReader
    heard: float = -math.inf


class UdpChannel:
    """Listens on a UDP port held exclusively. Each sender has its own parser, so none can corrupt another's packets."""

    def __init__(self, address: LinkAddress, settings: LinkSettings, admits: Admits | None = None) -> None:
        self.ended, self.working = False, True
        self.skips: Skips | None = None
        self._admits = admits
        self._socket = bind_udp(address.host, address.port, settings.receive_buffer_bytes)
        self._datagrams = DatagramReader(self._socket)
        self._peers: OrderedDict[tuple[str, int], _Peer] = OrderedDict()

    @property
    def skipped_bytes(self) -> int:
        return sum(peer.reader.skipped_bytes for peer in self._peers.values())

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        arrivals: list[Arrival | Notice] = []
        for data, sender, received in self._datagrams.read(timeout_s):
            name = host_and_port(*sender)
            if self.skips is not None and self.skips(name, data, received):
                continue
            peer = self._peer(sender)
            messages = peer.reader.feed(data)
            if messages:
                peer.heard = received
            arrivals += [Arrival(message, received, name) for message in messages]
        return arrivals

    def send(self, packet: bytes) -> bool:
        now, sent = time.monotonic(), False
        for address, peer in self._peers.items():
            if now - peer.heard <= _PEER_GONE_S:
                with suppress(OSError):  # network down or buffer full: normal on a radio link
                    sent |= self._socket.sendto(packet, address) > 0
        return sent

    def close(self) -> None:
        self._socket.close()

    def _peer(self, address: tuple[str, int]) -> _Peer:
        peer = self._peers.setdefault(address, _Peer(PacketReader(datagrams=True, admits=self._admits)))
        self._peers.move_to_end(address)
        if len(self._peers) > _MOST_PEERS:
            self._peers.popitem(last=False)
        return peer


class CallingChannel:
    """Sends to a remote UDP port and receives from that peer only."""

    def __init__(self, address: LinkAddress, settings: LinkSettings, admits: Admits | None = None) -> None:
        if settings.announce is None:
            raise UsageError(
                f"--mavlink {connection_string(address)!r} calls out, but nothing is ever sent and so nothing would "
                "answer: use udp:14550 and let the other side send to that port, or add --announce."
            )
        self.ended, self.working = False, True
        self._reader = PacketReader(datagrams=True, admits=admits)
        self._socket = socket.socket(family_of(address.host), socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, settings.receive_buffer_bytes)
        try:
            self._socket.connect((address.host, address.port))
        except OSError as error:
            self._socket.close()
            raise UsageError(
                f"--mavlink {connection_string(address)!r} cannot be called ({error.strerror}): give the address of a "
                "machine that can be reached, such as udpout:192.168.1.10:14550."
            ) from error
        self._datagrams = DatagramReader(self._socket)

    @property
    def skipped_bytes(self) -> int:
        return self._reader.skipped_bytes

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        arrivals: list[Arrival | Notice] = []
        for data, _, received in self._datagrams.read(timeout_s):
            arrivals += [Arrival(message, received) for message in self._reader.feed(data)]
        return arrivals

    def send(self, packet: bytes) -> bool:
        try:
            return self._socket.send(packet) > 0
        except OSError:
            logger.debug("nothing can be sent", exc_info=True)
            return False

    def close(self) -> None:
        self._socket.close()
