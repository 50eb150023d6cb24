"""Camera triggers from a MAVLink link. It only listens: not one byte is ever sent."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from contextlib import closing

from gcs_mosaic.events import LinkReport, Notice, TriggerEvent
from gcs_mosaic.link.address import LinkAddress
from gcs_mosaic.link.channels import Channel, open_channel
from gcs_mosaic.link.listener import Listener, VehicleChoice
from gcs_mosaic.link.recording import Recording
from gcs_mosaic.link.settings import LinkSettings


def triggers(
    address: LinkAddress,
    stop: threading.Event,
    settings: LinkSettings | None = None,
    choice: VehicleChoice | None = None,
    recording: Recording | None = None,
) -> Generator[TriggerEvent | Notice | LinkReport, None, None]:
    """Camera events, how the link is, and what must be said about it, until `stop` is set (or a recording ends).

    The link is opened by this call, not by the first `next`: UsageError (a port that is taken, a file that is not
    there) comes at once. `close` gives the link back. Several links to one aircraft share a `choice`
    and a `recording`.
    """
    settings = settings or LinkSettings()
    choice = choice or VehicleChoice(settings.vehicle)
    channel = open_channel(address, settings)
    now = time.monotonic()
    listener = Listener(address, settings, choice, now, time.time() - now)
    listening = _listen(channel, listener, recording or Recording(), stop, settings)
    next(listening)  # because only a generator that has begun gives its port back when it is closed
    return listening


def _listen(
    channel: Channel, listener: Listener, recording: Recording, stop: threading.Event, settings: LinkSettings
) -> Generator[TriggerEvent | Notice | LinkReport, None, None]:
    with closing(channel):
        greeting = listener.greeting()
        yield greeting  # to `triggers`, to begin
        yield greeting
        while not stop.is_set() and not channel.ended:
            for arrival in channel.read(settings.poll_s):
                if isinstance(arrival, Notice):
                    yield arrival
                else:
                    recording.record(arrival)
                    yield from listener.hear(arrival.message, arrival.received)
            yield from recording.flush(time.monotonic())
            yield from listener.tick(time.monotonic(), working=channel.working, noise=channel.skipped_bytes)
        yield listener.farewell()
