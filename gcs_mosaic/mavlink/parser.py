"""Bytes -> MAVLink messages. A corrupt packet never costs the packets after it."""

from __future__ import annotations

import os
import re
from collections.abc import Callable

os.environ["MAVLINK20"] = "1"  # MAVLink 2 for every later import of pymavlink: message ids above 255
from pymavlink.dialects.v20 import ardupilotmega as dialect  # the one dialect with 112, 180 and 263

from gcs_mosaic.mavlink.messages import MavMessage

__all__ = ["MARKERS", "PacketReader", "decode_packet", "dialect", "packet_length"]

_MARKER_V1 = 0xFE
MARKERS = re.compile(rb"[\xfd\xfe]")
_CHECKSUM = 2
_SIGNED = 1
_SIGNATURE = 13
_LONGEST_PACKET = 280

MOST_FAILED = 256  # corrupt packets of a chunk: 4 KB of noise have 32 bytes that begin one

_parser = dialect.MAVLink(None)  # keeps no state from one packet to the next


class PacketReader:
    """Parses one peer's byte stream, in chunks of any size; never raises, buffers less than one packet.

    After a corrupt packet the parser resynchronises one byte further on. pymavlink's own parser would drop as many bytes
    as the corrupt header claims, and good packets with them. `datagrams`: a datagram that starts with a whole packet does
    not continue the previous one. `admits` decides on every intact packet. Of one chunk so many beginnings are tried at most:
    each costs a checksum, and a chunk of nothing else would hold up the link for a second.
    """

    def __init__(self, *, datagrams: bool, admits: Callable[[bytes], bool] | None = None) -> None:
        self.skipped_bytes = 0
        self._datagrams, self._admits = datagrams, admits
        self._rest = b""

    def feed(self, data: bytes) -> list[MavMessage]:
        """The messages completed by `data`; corrupt packets and those of other dialects are skipped."""
        buffer = data if self._begins_afresh(data) else self._rest + data
        self.skipped_bytes += len(self._rest) + len(data) - len(buffer)
        messages, position, used, failed = list[MavMessage](), 0, 0, 0
        while marker := MARKERS.search(buffer, position):
            position = marker.start()
            end = position + packet_length(buffer, position)
            if end > len(buffer):
                break
            message = decode_packet(buffer[position:end])
            if message:
                used += end - position
                if self._admits is None or self._admits(buffer[position:end]):
                    messages.append(message)
            elif (failed := failed + 1) > MOST_FAILED:
                marker = None
                break
            position = end if message else position + 1
        self._rest = buffer[position:] if marker else b""
        self.skipped_bytes += len(buffer) - len(self._rest) - used
        return messages

    def _begins_afresh(self, data: bytes) -> bool:
        if not (self._datagrams and self._rest and MARKERS.match(data)):
            return False
        length = packet_length(data, 0)
        return len(data) >= length and decode_packet(data[:length]) is not None


def decode_packet(packet: bytes) -> MavMessage | None:
    """The message in exactly one packet; None if it is corrupt or of another dialect."""
    if packet[0] != _MARKER_V1 and packet[2] & ~_SIGNED:  # an undefined incompatibility flag
        return None
    try:
        message = _parser.decode(bytearray(packet))
    except dialect.MAVError:
        return None
    return None if isinstance(message, dialect.MAVLink_unknown) else message


def packet_length(buffer: bytes, start: int) -> int:
    """Length of the packet at `start` according to its header; the maximum if the header is truncated."""
    if len(buffer) < start + 3:
        return _LONGEST_PACKET
    payload, flags = buffer[start + 1], buffer[start + 2]
    if buffer[start] == _MARKER_V1:
        return 6 + payload + _CHECKSUM
    return 10 + payload + _CHECKSUM + (_SIGNATURE if flags & _SIGNED else 0)
