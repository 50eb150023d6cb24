"""Rate limiting of triggers: a flood, by fault or forgery, must not bury the real ones. Pure; time is passed in.

One leaky bucket per source. A source that overflows its bucket is no camera and is blocked until it has been quieter for
some seconds; other sources are unaffected. The number of sources is bounded, so a forger who changes identity with each
message gains nothing, provided the camera was heard first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

Verdict = Literal["admitted", "left out", "closed", "opened"]

MOST_SOURCES = 16  # per link; an autopilot has up to three, each of MAVLink's six cameras one
_FORGOTTEN_AFTER_S = 60.0  # a source silent for this long may be evicted
_OPENED_AT = 0.5  # of a full bucket: hysteresis against floods that come in waves


class TriggerSource(NamedTuple):
    """The sender of one type of camera message. `sender` is the peer's address, where the link knows it."""

    sender: str
    system: int
    component: int
    message: str

    def __str__(self) -> str:
        return f"{self.message} of system {self.system}, component {self.component}"


@dataclass(slots=True)
class _Bucket:
    level: float = 0.0
    last: float = 0.0
    closed: bool = False


class FloodGate:
    """Admits or drops each camera message; `left_out` counts the dropped ones."""

    def __init__(self, per_second: float, at_once: int) -> None:
        self.left_out = 0
        self._per_second, self._at_once = per_second, at_once
        self._buckets: dict[TriggerSource, _Bucket] = {}

    def ask(self, source: TriggerSource, now: float) -> Verdict:
        """Verdict on a message received at `now` (monotonic seconds): `opened` admits it, `closed` drops it."""
        bucket = self._bucket(source, now)
        verdict = "left out" if bucket is None else self._pour(bucket, now)
        self.left_out += verdict in ("left out", "closed")
        return verdict

    def _bucket(self, source: TriggerSource, now: float) -> _Bucket | None:
        bucket = self._buckets.get(source)
        if bucket is None:
            if len(self._buckets) >= MOST_SOURCES:
                recent = {one: kept for one, kept in self._buckets.items() if now - kept.last < _FORGOTTEN_AFTER_S}
                self._buckets = recent
            if len(self._buckets) >= MOST_SOURCES:
                return None
            bucket = self._buckets[source] = _Bucket(last=now)
        return bucket

    def _pour(self, bucket: _Bucket, now: float) -> Verdict:
        leaked = self._per_second * max(0.0, now - bucket.last)
        bucket.level, bucket.last = max(0.0, bucket.level - leaked), now
        if bucket.closed:
            if bucket.level <= _OPENED_AT * self._at_once:
                bucket.closed = False
                bucket.level += 1
                return "opened"
            bucket.level = min(bucket.level + 1, float(self._at_once))
            return "left out"
        bucket.level += 1
        if bucket.level > self._at_once:
            bucket.closed, bucket.level = True, float(self._at_once)
            return "closed"
        return "admitted"
