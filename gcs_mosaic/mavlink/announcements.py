"""Schedules our own HEARTBEAT and STATUSTEXT messages. Pure; time is passed in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import dialect

HEARTBEAT_EVERY_S = 1.0
TEXT_EVERY_S = 2.0  # ground stations read texts aloud, and telemetry radios have little bandwidth
SAME_TOPIC_EVERY_S = 10.0  # ... and repetitions are ignored
_LONGEST_TEXT = 50  # bytes of a STATUSTEXT

Topic: TypeAlias = str  # such as "disk"; each aircraft's overlap is one of its own


@dataclass(frozen=True, slots=True)
class Announcement:
    """A short text for the operator at the ground station; only the newest on a topic counts."""

    topic: Topic
    text: str
    warning: bool = True


class Announcer:
    """Rate limiter: HEARTBEAT once a second, STATUSTEXT rarely, however often `tell` is called."""

    def __init__(self) -> None:
        self._heartbeat_due = self._text_due = 0.0
        self._waiting: dict[Topic, Announcement] = {}
        self._topic_due: dict[Topic, float] = {}

    def tell(self, announcement: Announcement) -> None:
        """Queue a text; it replaces an unsent one on the same topic."""
        self._waiting[announcement.topic] = announcement

    def due(self, now: float, *, reachable: bool = True) -> Iterator[MavMessage]:
        """Messages to send at `now` (monotonic seconds); texts wait until a peer is `reachable`."""
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + HEARTBEAT_EVERY_S
            yield heartbeat()
        ripe = (topic for topic in self._waiting if now >= self._topic_due.get(topic, 0.0))
        topic = next(ripe, None) if reachable and now >= self._text_due else None
        if topic is not None:
            self._text_due, self._topic_due[topic] = now + TEXT_EVERY_S, now + SAME_TOPIC_EVERY_S
            yield status_text(self._waiting.pop(topic))


def heartbeat() -> MavMessage:
    """HEARTBEAT of an onboard controller without an autopilot: nothing that can be armed or flown."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER,
        dialect.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=dialect.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )


def status_text(announcement: Announcement) -> MavMessage:
    severity = dialect.MAV_SEVERITY_WARNING if announcement.warning else dialect.MAV_SEVERITY_INFO
    text = announcement.text.encode("ascii", "replace")[:_LONGEST_TEXT]
    return dialect.MAVLink_statustext_message(severity, text)
