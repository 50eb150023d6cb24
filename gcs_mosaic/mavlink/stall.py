"""Dates what a byte stream brought while the program stood still (a suspended laptop, SIGSTOP): it is all read at once. Pure.

The kernel tells no receive times here, but telemetry comes at an even rate, so the bytes are spread evenly over the pause. That
dates messages without a time of their own; senders' clocks must not learn from it, so it is marked as an estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.received import Arrival

STALLED_S = 1.0  # a read this much later than it should have returned


def spread(messages: Iterable[MavMessage], size: int, start: float, end: float) -> Iterator[Arrival]:
    """The messages in `size` bytes that arrived at an even rate from `start` to `end`, when they were read."""
    position = 0
    for message in messages:
        position += len(message.get_msgbuf())
        yield Arrival(message, start + (end - start) * min(position / size, 1.0), latest=end)
