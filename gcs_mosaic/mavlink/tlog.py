"""Telemetry logs (.tlog): each packet is preceded by its arrival time in microseconds since 1970 (big-endian, 64 bits)."""

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
_LONGEST_GAP_S = 86400.0  # a longer gap between packets is a corrupt timestamp
_AT_ONCE = 256


class TlogChannel:
    """Plays a recording as fast as it can be read; arrival times keep the recorded intervals, starting when it is opened."""

    def __init__(self, address: LinkAddress) -> None:
        self.ended, self.working = False, True
        self.skipped_bytes = 0  # corruption in a recording is skipped without being counted
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
    """(seconds since 1970, message) of every intact packet; corrupt stretches are skipped."""
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
    """Messages at the recorded intervals from `start` on; backward and implausible steps count as zero."""
    now, before = start, None
    for seconds, message in recorded:
        step = seconds - before if before is not None else 0.0
        now += step if 0 <= step <= _LONGEST_GAP_S else 0.0
        before = seconds
        yield Arrival(message, now)
