"""Rate limiting of triggers: a flood, by fault or forgery, must not bury the real ones. Pure; time is passed in.

One leaky bucket per source, and one for all whose pictures have not been found yet. Of a source that overflows its own the
messages are dropped until it has been quieter for some seconds: it is no camera. One that comes faster than its rate, be it a
flood or what a link held back, is held until it is known which. Sources whose shots found their pictures are trusted: nothing
that others do costs them a message.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from gcs_mosaic.mavlink.messages import AUTOPILOT_COMPONENT
from gcs_mosaic.messages import Source, Teller, TriggerEvent

Verdict = Literal["admitted", "held", "left out", "closed", "opened"]

MOST_SOURCES = 64  # per link; an autopilot has up to three, each of MAVLink's six cameras one
# Of MAVLink 2: marker, length, flags, flags, counter, system, component, message id.
_HEADER = struct.Struct("<xBBxxBBHB")
_MAVLINK_2, _CHECKSUM, _SIGNED, _SIGNATURE = 0xFD, 2, 1, 13
_KINDS = {112: Source.CAMERA_TRIGGER, 180: Source.CAMERA_FEEDBACK, 263: Source.IMAGE_CAPTURED_BY_CAMERA}
UNKNOWN_AT_ONCE = 10  # messages of an unknown source beyond its rate; what exceeds it is held
_CROWDED = 10  # so much slower unknown sources are let in while they are a crowd and the camera's own is known
_OPENED_AT = 0.5  # of a full bucket: hysteresis against floods that come in waves


class Trust:
    """The sources whose shots have found their pictures: what pairing learns, told back to all links.

    The event log alone writes it, links and streams read it; replaced as a whole, hence thread-safe.
    """

    def __init__(self) -> None:
        self.sources: frozenset[Teller] = frozenset()


@dataclass(slots=True)
class _Bucket:
    level: float = 0.0
    last: float = 0.0
    closed: bool = False
    held: list[TriggerEvent] = field(default_factory=list)

    def leak(self, per_second: float, now: float) -> None:
        self.level = max(0.0, self.level - per_second * max(0.0, now - self.last))
        self.last = max(now, self.last)


class FloodGate:
    """Admits, holds or drops each camera message; `left_out` counts the dropped ones."""

    def __init__(self, per_second: float, at_once: int, trust: Trust | None = None) -> None:
        self.left_out = 0
        self._per_second, self._at_once = per_second, at_once
        self._trust = trust or Trust()
        self._buckets: OrderedDict[Teller, _Bucket] = OrderedDict()  # last heard last
        self._unknown = _Bucket()  # of all sources that are not trusted
        self.is_crowded = False
        """Whether more sources speak, or speak more together, than an aircraft has."""

    def ask(self, event: TriggerEvent) -> tuple[Verdict, list[TriggerEvent]]:
        """Verdict on a message, and the messages let in by it: itself, after those of its source held before."""
        source, now = event.teller, event.received
        bucket = self._bucket(source, now)
        if bucket is None:
            self.left_out += 1
            return "left out", []
        verdict = self._pour(bucket, event, is_trusted=source in self._trust.sources)
        self.left_out += verdict in ("left out", "closed")
        if verdict not in ("admitted", "opened"):
            return verdict, []
        held, bucket.held = bucket.held, []
        return verdict, [*held, event]

    def skips(self, sender: str, data: bytes, now: float) -> bool:
        """Whether a datagram is one message of a source that is closed, by its header alone, and stays so; it is counted."""
        if len(data) < _HEADER.size or data[0] != _MAVLINK_2:
            return False
        length, flags, system, component, low, high = _HEADER.unpack_from(data)
        kind = _KINDS.get(low + (high << 16))
        if kind is None or len(data) != _HEADER.size + length + _CHECKSUM + (_SIGNATURE if flags & _SIGNED else 0):
            return False
        if kind is Source.IMAGE_CAPTURED_BY_CAMERA and component == AUTOPILOT_COMPONENT:
            kind = Source.IMAGE_CAPTURED_BY_AUTOPILOT
        bucket = self._buckets.get(Teller(sender, system, component, kind))
        if bucket is None or not bucket.closed:
            return False
        bucket.leak(self._per_second, now)
        if bucket.level <= _OPENED_AT * UNKNOWN_AT_ONCE:
            return False
        bucket.level = min(bucket.level + 1, float(self._at_once))
        self.left_out += 1
        return True

    def ripe(self, now: float) -> Iterator[TriggerEvent]:
        """Held messages of sources that have been quieter since, oldest first for each."""
        for source, bucket in self._buckets.items():
            if bucket.held:
                bucket.leak(self._per_second, now)
                calm = bucket.level <= _OPENED_AT * UNKNOWN_AT_ONCE or source in self._trust.sources
                while calm and bucket.held and (source in self._trust.sources or self._has_room(now)):
                    yield bucket.held.pop(0)

    def _bucket(self, source: Teller, now: float) -> _Bucket | None:
        bucket = self._buckets.get(source)
        if bucket is None:
            if len(self._buckets) >= MOST_SOURCES and not self._make_room():
                return None
            bucket = self._buckets[source] = _Bucket(last=now)
        self._buckets.move_to_end(source)
        return bucket

    def _make_room(self) -> bool:
        """Give up the place of the source silent longest whose pictures were never found."""
        self.is_crowded = True
        unknown = next((source for source in self._buckets if source not in self._trust.sources), None)
        if unknown is not None:
            self.left_out += len(self._buckets.pop(unknown).held)
        return unknown is not None

    def _pour(self, bucket: _Bucket, event: TriggerEvent, *, is_trusted: bool) -> Verdict:
        bucket.leak(self._per_second, event.received)
        if bucket.closed:
            if bucket.level > _OPENED_AT * (self._at_once if is_trusted else UNKNOWN_AT_ONCE):
                bucket.level = min(bucket.level + 1, float(self._at_once))
                return "left out"
            bucket.closed = False
            bucket.level += 1
            return "opened" if is_trusted or self._has_room(event.received) else self._hold(bucket, event)
        bucket.level += 1
        most = self._at_once if is_trusted or not self.is_crowded else 2 * UNKNOWN_AT_ONCE
        if bucket.level > most:
            bucket.closed, bucket.level = True, float(self._at_once)
            self.left_out += len(bucket.held)
            bucket.held.clear()
            return "closed"
        if is_trusted or (bucket.level <= UNKNOWN_AT_ONCE and self._has_room(event.received)):
            return "admitted"
        return self._hold(bucket, event)

    def _hold(self, bucket: _Bucket, event: TriggerEvent) -> Verdict:
        bucket.held.append(event)
        if len(bucket.held) > self._at_once:
            bucket.held.pop(0)
            return "left out"
        return "held"

    def _has_room(self, now: float) -> bool:
        """Room for one more message of an unknown source."""
        known = self.is_crowded and self._trust.sources
        self._unknown.leak(self._per_second / (_CROWDED if known else 1), now)
        if self._unknown.level + 1 > self._at_once:
            self.is_crowded = True
            return False
        self._unknown.level += 1
        return True
