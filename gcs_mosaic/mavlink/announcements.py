"""Announcing ourselves: a heartbeat, and a few words when the operator should look. Pure; time comes as an argument."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import dialect

HEARTBEAT_EVERY_S = 1.0
TEXT_EVERY_S = 2.0  # a ground station reads texts aloud; a telemetry radio has room for little
SAME_TOPIC_EVERY_S = 10.0  # ... and nobody listens to what is said again and again
_LONGEST_TEXT = 50  # bytes of a STATUSTEXT

Topic = Literal["overlap", "frames", "disk"]


@dataclass(frozen=True, slots=True)
class Announcement:
    """A few words for the operator at the ground station; the newest about a topic is what counts."""

    topic: Topic
    text: str
    warning: bool = True


class Announcer:
    """What is to be sent when: HEARTBEAT once a second, STATUSTEXT seldom, however often it is told something."""

    def __init__(self) -> None:
        self._heartbeat_due = self._text_due = 0.0
        self._waiting: dict[Topic, Announcement] = {}
        self._topic_due: dict[Topic, float] = {}

    def tell(self, announcement: Announcement) -> None:
        """Something is to be said; an earlier word on the same topic that was not said yet is left out."""
        self._waiting[announcement.topic] = announcement

    def due(self, now: float, *, reachable: bool = True) -> Iterator[MavMessage]:
        """What is to be sent at `now` (monotonic seconds); words wait until somebody is `reachable`."""
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + HEARTBEAT_EVERY_S
            yield heartbeat()
        ripe = (topic for topic in self._waiting if now >= self._topic_due.get(topic, 0.0))
        topic = next(ripe, None) if reachable and now >= self._text_due else None
        if topic is not None:
            self._text_due, self._topic_due[topic] = now + TEXT_EVERY_S, now + SAME_TOPIC_EVERY_S
            yield status_text(self._waiting.pop(topic))


def heartbeat() -> MavMessage:
    """A program beside the ground station: no autopilot, nothing that can be armed or flown."""
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
