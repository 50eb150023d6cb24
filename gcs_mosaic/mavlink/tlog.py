"""A recorded link (.tlog): before each packet, the time it came in microseconds since 1970 (big-endian, 64 bits)."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from io import BufferedReader
from itertools import islice

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import MARKERS, decode_packet, packet_length
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.messages import Notice

TIME = struct.Struct(">Q")
_CHUNK = 1 << 16
_LONGEST_GAP_S = 86400.0  # a recording does not pause for longer: a damaged time
_AT_ONCE = 256


class TlogChannel:
    """Plays a recording as fast as it is read; arrival times keep the recording's distances, from the opening on."""

    def __init__(self, address: LinkAddress) -> None:
        self.ended, self.working = False, True
        self.skipped_bytes = 0  # a recording is not listened to: damage in it is passed over
        assert address.path is not None
        try:
            self._file = address.path.open("rb")
        except OSError as error:
            raise UsageError(
                f"--mavlink {str(address.path)!r} cannot be read ({error.strerror}): "
                "give a recording (.tlog) that exists."
            ) from error
        self._arrivals = on_one_clock(read_tlog(self._file), time.monotonic())

    def read(self, timeout_s: float) -> list[Arrival | Notice]:
        arrivals = list[Arrival | Notice](islice(self._arrivals, _AT_ONCE))
        self.ended = not arrivals
        return arrivals

    def send(self, packet: bytes) -> bool:
        return False

    def close(self) -> None:
        self._file.close()


def read_tlog(file: BufferedReader) -> Iterator[tuple[float, MavMessage]]:
    """(seconds since 1970, message) for every whole packet; damaged stretches are passed over."""
    buffer = b""
    at_end = False
    while not at_end:
        chunk = file.read(_CHUNK)
        at_end = not chunk
        buffer += chunk
        position = 0
        while marker := MARKERS.search(buffer, position + TIME.size):
            start = marker.start()
            end = start + packet_length(buffer, start)
            if end > len(buffer) and not at_end:
                break
            message = decode_packet(buffer[start:end]) if end <= len(buffer) else None
            if message:
                yield TIME.unpack_from(buffer, start - TIME.size)[0] / 1e6, message
            position = end if message else start + 1 - TIME.size
        keep_from = marker.start() if marker else max(position + TIME.size, len(buffer))
        buffer = buffer[keep_from - TIME.size :]


def on_one_clock(recorded: Iterator[tuple[float, MavMessage]], start: float) -> Iterator[Arrival]:
    """Messages at the recording's distances in time from `start` on; steps back and absurd ones take no time."""
    now, before = start, None
    for seconds, message in recorded:
        step = seconds - before if before is not None else 0.0
        now += step if 0 <= step <= _LONGEST_GAP_S else 0.0
        before = seconds
        yield Arrival(message, now)
