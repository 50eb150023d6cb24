"""Converts times since boot to UTC by the sender's own SYSTEM_TIME; for display only. Pure."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace

from gcs_mosaic.mavlink.clock import plausible_utc
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.messages import FEEDBACK_WRAP_S, Source, TriggerEvent, unwrapped

_MOST_SENDERS = 32  # no link has as many, but a forger might


@dataclass(frozen=True, slots=True)
class _BootTime:
    """One component's last SYSTEM_TIME. Times are in seconds."""

    boot: float
    received: float
    utc_of_boot: float | None  # UTC at the zero of its boot clock, None while it does not know the date


class VehicleTimes:
    """Boot time -> UTC for every component that sends SYSTEM_TIME (message 2). Each has its own boot clock."""

    def __init__(self) -> None:
        self._senders: OrderedDict[tuple[int, int], _BootTime] = OrderedDict()

    def hear(self, message: MavMessage, received: float) -> None:
        """Update from a message, if it is SYSTEM_TIME; implausible years are ignored."""
        if message.get_type() != "SYSTEM_TIME":
            return
        sender, boot = (message.get_srcSystem(), message.get_srcComponent()), message.time_boot_ms / 1e3
        utc, before = plausible_utc(message.time_unix_usec / 1e6), self._senders.get(sender)
        if utc is not None:
            utc_of_boot: float | None = utc - boot
        else:
            # A GPS receiver that loses its fix keeps counting; after a reboot the date is unknown.
            utc_of_boot = before.utc_of_boot if before and boot >= before.boot else None
        self._senders[sender] = _BootTime(boot, received, utc_of_boot)
        self._senders.move_to_end(sender)
        if len(self._senders) > _MOST_SENDERS:
            self._senders.popitem(last=False)

    def dated(self, event: TriggerEvent) -> TriggerEvent:
        """The event with UTC filled in, where it has none of its own and its sender's date is known."""
        sender = self._senders.get((event.vehicle, event.component))
        if event.utc is not None or event.clock != "boot" or event.source_time is None or sender is None:
            return event
        if sender.utc_of_boot is None:
            return event
        happened = event.source_time
        if event.source is Source.CAMERA_FEEDBACK:
            happened = unwrapped(happened, sender.boot + event.received - sender.received, FEEDBACK_WRAP_S)
        return replace(event, utc=plausible_utc(sender.utc_of_boot + happened))
