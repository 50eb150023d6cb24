"""Camera triggers from a MAVLink link. It only listens: not one byte is ever sent."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing

from gcs_mosaic.events import Notice, TriggerEvent
from gcs_mosaic.link.address import LinkAddress
from gcs_mosaic.link.channels import Channel, open_channel
from gcs_mosaic.link.listener import Listener, VehicleChoice
from gcs_mosaic.link.settings import LinkSettings


def triggers(
    address: LinkAddress,
    stop: threading.Event,
    settings: LinkSettings | None = None,
    choice: VehicleChoice | None = None,
) -> Iterator[TriggerEvent | Notice]:
    """Camera events and what must be said about the link, until `stop` is set (or a recording ends).

    The link is opened by this call, not by the first `next`: UsageError (a port that is taken, a file that is not
    there) comes at once. Several links to one aircraft share a `choice`.
    """
    settings = settings or LinkSettings()
    choice = choice or VehicleChoice(settings.vehicle)
    channel = open_channel(address, settings)
    return _listen(channel, Listener(address, settings, choice, time.monotonic()), stop, settings)


def _listen(
    channel: Channel, listener: Listener, stop: threading.Event, settings: LinkSettings
) -> Iterator[TriggerEvent | Notice]:
    with closing(channel):
        yield listener.greeting()
        while not stop.is_set() and not channel.ended:
            for arrival in channel.read(settings.poll_s):
                if isinstance(arrival, Notice):
                    yield arrival
                else:
                    yield from listener.hear(arrival.message, arrival.received)
            yield from listener.tick(time.monotonic())
        yield listener.farewell()
