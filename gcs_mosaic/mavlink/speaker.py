"""Outgoing traffic of one link, only if asked for. A link without a speaker sends nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, Full, Queue

from gcs_mosaic.mavlink.announcements import Announcement, Announcer
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.resend import Recovery
from gcs_mosaic.mavlink.transmitter import OWN_COMPONENT, Transmitter
from gcs_mosaic.messages import Notice, TriggerEvent

_ROOM = 16  # queued announcements; there are three topics, and only the newest of each counts


class Speaker:
    """Belongs to the link's thread; only `tell` may be called from others."""

    def __init__(
        self,
        name: str,
        transmitter: Transmitter,
        recovery: Recovery | None = None,
        taken: threading.Event | None = None,
    ) -> None:
        """`name` is the link's; `taken` is set when someone else is heard under our system id, on any link."""
        self.identity = f"system {transmitter.system}, component {OWN_COMPONENT}"
        self._name, self._transmitter, self._recovery = name, transmitter, recovery
        self._announcer = Announcer()
        self._told: Queue[Announcement] = Queue(_ROOM)
        self.reachable = False  # whether the last packet was sent: there may be no peer yet, or the line be down
        self._taken = taken or threading.Event()

    def tell(self, announcement: Announcement) -> None:
        """Queue an announcement; dropped if the queue is full."""
        with suppress(Full):
            self._told.put_nowait(announcement)

    def hear(self, message: MavMessage, now: float) -> Iterator[Notice]:
        """Watch a received message for a system id conflict and for a camera's refusal."""
        # Component 191 of our system is our own traffic, echoed by a router.
        other = message.get_srcSystem() == self._transmitter.system and message.get_srcComponent() != OWN_COMPONENT
        if other and not self._taken.is_set():
            self._taken.set()
            text = f"another has our number, {self._transmitter.system}: nothing is sent any more, choose another --announce"
            yield Notice(source=self._name, level="error", text=f"{self._name}: {text}")
        if self._recovery and self._recovery.acknowledged(message, self._transmitter.system, now):
            text = f"{self._name}: the camera does not send its messages again, and is asked no more"
            yield Notice(source=self._name, level="info", text=text)

    def note(self, event: TriggerEvent, now: float) -> None:
        """Register a camera event."""
        if self._recovery:
            self._recovery.note(event, self._name, now)

    def due(self, now: float) -> Iterator[bytes]:
        """Packets to send at `now` (monotonic seconds)."""
        with suppress(Empty):
            while True:
                self._announcer.tell(self._told.get_nowait())
        if self._taken.is_set():  # two systems with one id are a hazard
            return
        for message in self._announcer.due(now, reachable=self.reachable):
            yield self._transmitter.packet(message, now)
        if self._recovery and (question := self._recovery.due(self._name, now)):
            yield self._transmitter.packet(question, now)
