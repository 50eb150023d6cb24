"""Camera triggers from a MAVLink link. It only listens: not one byte is ever sent."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing

from gcs_mosaic.events import LinkReport, Notice, TriggerEvent
from gcs_mosaic.link.address import LinkAddress
from gcs_mosaic.link.channels import Channel, open_channel
from gcs_mosaic.link.listener import Listener, VehicleChoice
from gcs_mosaic.link.settings import LinkSettings


def triggers(
    address: LinkAddress,
    stop: threading.Event,
    settings: LinkSettings | None = None,
    choice: VehicleChoice | None = None,
) -> Iterator[TriggerEvent | Notice | LinkReport]:
    """Camera events, how the link is, and what must be said about it, until `stop` is set (or a recording ends).

    The link is opened by this call, not by the first `next`: UsageError (a port that is taken, a file that is not
    there) comes at once. Several links to one aircraft share a `choice`.
    """
    settings = settings or LinkSettings()
    choice = choice or VehicleChoice(settings.vehicle)
    channel = open_channel(address, settings)
    now = time.monotonic()
    return _listen(channel, Listener(address, settings, choice, now, time.time() - now), stop, settings)


def _listen(
    channel: Channel, listener: Listener, stop: threading.Event, settings: LinkSettings
) -> Iterator[TriggerEvent | Notice | LinkReport]:
    with closing(channel):
        yield listener.greeting()
        while not stop.is_set() and not channel.ended:
            for arrival in channel.read(settings.poll_s):
                if isinstance(arrival, Notice):
                    yield arrival
                else:
                    yield from listener.hear(arrival.message, arrival.received)
            yield from listener.tick(time.monotonic(), working=channel.working, noise=channel.skipped_bytes)
        yield listener.farewell()
