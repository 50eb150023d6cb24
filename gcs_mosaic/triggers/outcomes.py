"""Outcomes of events and frames, and their totals."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

from gcs_mosaic.messages import Frame, TriggerEvent


class How(IntEnum):
    """What a match is based on; a higher value is more reliable and may override a lower one."""

    TIME = 1
    SEQUENCE = 2
    NAME = 3
    ASKED = 4  # the frame was taken from a live stream for this event


@dataclass(frozen=True, slots=True)
class Matched:
    """The event announced the frame. May follow long after either, also after `Missing` or `Orphan`."""

    event_id: int
    event: TriggerEvent
    frame: Frame
    how: How


@dataclass(frozen=True, slots=True)
class Unmatched:
    """An earlier match was wrong: the event is pending again, the frame an orphan again."""

    event_id: int
    frame: Frame


@dataclass(frozen=True, slots=True)
class Missing:
    """The event's frame has not arrived in time; if it arrives later, `Matched` follows."""

    event_id: int
    event: TriggerEvent


@dataclass(frozen=True, slots=True)
class Failed:
    """The camera reported that it took no picture."""

    event_id: int
    event: TriggerEvent


@dataclass(frozen=True, slots=True)
class Orphan:
    """No event is known for this frame so far. It is stitched all the same."""

    frame: Frame


Outcome: TypeAlias = Matched | Unmatched | Missing | Failed | Orphan


@dataclass(frozen=True, slots=True, kw_only=True)
class EventCounts:
    """Number of events in each state, and of frames without an event."""

    pending: int
    matched: int
    missing: int
    duplicate: int
    failed: int
    orphans: int

    @property
    def events(self) -> int:
        """All events received; each is in exactly one state."""
        return self.pending + self.matched + self.missing + self.duplicate + self.failed

    @property
    def frames(self) -> int:
        """All frames received; each is matched or an orphan."""
        return self.matched + self.orphans
