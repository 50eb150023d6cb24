"""Camera triggers from a MAVLink link. Without a speaker the link is receive-only: not one byte is sent."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field
from typing import TypeAlias

from gcs_mosaic.even_clock import even_utc_of_zero
from gcs_mosaic.mavlink.address import LinkAddress, connection_string
from gcs_mosaic.mavlink.channels import Channel, UdpChannel, open_channel
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.mavlink.monitor import NO_REFUSALS, Listener
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing
from gcs_mosaic.mavlink.speaker import Speaker
from gcs_mosaic.mavlink.tlog_writer import Recording
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import LinkReport, Notice, StreamOffer, TriggerEvent

logger = logging.getLogger(__name__)

AGAIN_S = 1.0  # after a failure
MOST_SAID = 8  # kinds of failures

Items: TypeAlias = Generator[TriggerEvent | StreamOffer | Notice | LinkReport, None, None]


def triggers(
    address: LinkAddress,
    stop: threading.Event,
    settings: LinkSettings | None = None,
    choice: VehicleChoice | None = None,
    recording: Recording | None = None,
    signing: Signing | None = None,
    speaker: Speaker | None = None,
    trust: Trust | None = None,
) -> Items:
    """Camera events, link reports and notices, until `stop` is set (or a recording ends).

    The link is opened by this call, not by the first `next`, so UsageError (port in use, missing file) is raised at once.
    `close` releases the link. Several links to one aircraft share a `choice`, `trust` and a `recording`; `signing` and `speaker`
    belong to this link alone.
    """
    settings = settings or LinkSettings()
    choice = choice or VehicleChoice(settings)
    channel = open_channel(address, settings, signing)
    now = time.monotonic()
    listener = Listener(address, settings, choice, now, even_utc_of_zero, trust)
    if isinstance(channel, UdpChannel):
        channel.skips = listener.skips
    link = _Link(channel, listener, recording or Recording(), signing, speaker, connection_string(address))
    listening = link.listen(stop, settings.poll_s)
    next(listening)  # only a generator that has started runs its cleanup, and releases the port, on close
    return listening


@dataclass(slots=True)
class _Link:
    """The parts of one open link."""

    channel: Channel
    listener: Listener
    recording: Recording
    signing: Signing | None
    speaker: Speaker | None
    name: str
    sent: int = 0  # packets
    said: set[str] = field(default_factory=set)  # kinds of failures

    def listen(self, stop: threading.Event, poll_s: float) -> Items:
        with closing(self.channel):
            greeting = self.listener.greeting(self.speaker.identity if self.speaker else None)
            yield greeting  # consumed by `triggers`, to start the generator
            yield greeting
            while not stop.is_set() and not self.channel.ended:
                yield from self._listen_whatever_comes(stop, poll_s)
            if self.channel.working and not self.channel.ended:  # what came before the end, and is still in the kernel
                yield from self._listen_whatever_comes(stop, 0.0)
            yield from self.listener.farewell(time.monotonic())

    def _listen_whatever_comes(self, stop: threading.Event, poll_s: float) -> Items:
        try:
            yield from self._listen_once(poll_s)
        except Exception as error:
            logger.exception("a link has failed")
            yield from self._failed(error)
            stop.wait(AGAIN_S)

    def _listen_once(self, poll_s: float) -> Items:
        for arrival in self.channel.read(poll_s):
            yield from (arrival,) if isinstance(arrival, Notice) else self._hear(arrival)
        yield from self.recording.flush(time.monotonic())
        if self.speaker:
            self._speak(self.speaker)
        yield from self._look()

    def _failed(self, error: Exception) -> Items:
        """No failure ends a link: what came with it is lost, and it is listened to again. Said once for each kind."""
        kind = f"{type(error).__name__} {getattr(error, 'errno', None) or ''}".strip()
        if kind not in self.said and len(self.said) < MOST_SAID:
            self.said.add(kind)
            text = f"{self.name} has failed ({kind}); it is listened to again"
            yield Notice(source=self.name, level="error", text=text)

    def _hear(self, arrival: Arrival) -> Items:
        self.recording.record(arrival)
        for item in self.listener.hear(arrival.message, arrival.received, arrival.sender, arrival.latest):
            if self.speaker and isinstance(item, TriggerEvent):
                self.speaker.note(item, arrival.received)
            yield item
        if self.speaker:
            yield from self.speaker.hear(arrival.message, arrival.received)

    def _speak(self, speaker: Speaker) -> None:
        for packet in speaker.due(time.monotonic()):
            speaker.reachable = self.channel.send(packet)
            self.sent += speaker.reachable

    def _look(self) -> Items:
        yield from self.listener.tick(
            time.monotonic(),
            working=self.channel.working,
            noise=self.channel.skipped_bytes,
            refused=self.signing.refused if self.signing else NO_REFUSALS,
            sent=self.sent,
        )
