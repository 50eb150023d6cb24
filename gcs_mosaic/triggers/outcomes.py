"""What becomes of events and frames, and the sums over all of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

from gcs_mosaic.messages import Frame, TriggerEvent


class How(IntEnum):
    """What an event and a frame were matched by; a higher value is the better reason, and may undo a lesser one."""

    TIME = 1
    SEQUENCE = 2
    NAME = 3
    ASKED = 4  # the frame was taken from a live stream for this event


@dataclass(frozen=True, slots=True)
class Matched:
    """The event announced the frame. May come long after either, also for one that was missing or an orphan."""

    event_id: int
    event: TriggerEvent
    frame: Frame
    how: How


@dataclass(frozen=True, slots=True)
class Unmatched:
    """An earlier match was a mistake: the event waits again, the frame is an orphan again."""

    event_id: int
    frame: Frame


@dataclass(frozen=True, slots=True)
class Missing:
    """The event's frame has not come in time; if it does come, `Matched` follows."""

    event_id: int
    event: TriggerEvent


@dataclass(frozen=True, slots=True)
class Failed:
    """The camera said that it took no picture."""

    event_id: int
    event: TriggerEvent


@dataclass(frozen=True, slots=True)
class Orphan:
    """No event for this frame is known so far. It is stitched all the same."""

    frame: Frame


Outcome: TypeAlias = Matched | Unmatched | Missing | Failed | Orphan


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """How many events are in each state, and how many frames have an event."""

    pending: int
    matched: int
    missing: int
    duplicate: int
    failed: int
    orphans: int

    @property
    def events(self) -> int:
        """All events that were ever told; each is in exactly one state."""
        return self.pending + self.matched + self.missing + self.duplicate + self.failed

    @property
    def frames(self) -> int:
        """All frames that ever came; each is matched or an orphan."""
        return self.matched + self.orphans
