"""UTC of what happened on a clock that counts from boot, by the sender's own SYSTEM_TIME; for showing only. Pure."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace

from gcs_mosaic.mavlink.clock import plausible_utc
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.messages import FEEDBACK_WRAP_S, Source, TriggerEvent, unwrapped

_MOST_SENDERS = 32  # whose time is kept; no link has as many, but a forger might


@dataclass(frozen=True, slots=True)
class _BootTime:
    """What one component's clocks said last. Times are in seconds."""

    boot: float
    received: float
    utc_of_boot: float | None  # UTC at which its boot clock stood at zero, None while it does not know the date


class VehicleTimes:
    """Boot -> UTC for every component that sends SYSTEM_TIME (message 2). Each boots for itself."""

    def __init__(self) -> None:
        self._senders: OrderedDict[tuple[int, int], _BootTime] = OrderedDict()

    def hear(self, message: MavMessage, received: float) -> None:
        """Learn from a message, if it is SYSTEM_TIME; years in which nobody has flown with MAVLink are not believed."""
        if message.get_type() != "SYSTEM_TIME":
            return
        sender, boot = (message.get_srcSystem(), message.get_srcComponent()), message.time_boot_ms / 1e3
        utc, before = plausible_utc(message.time_unix_usec / 1e6), self._senders.get(sender)
        if utc is not None:
            utc_of_boot: float | None = utc - boot
        else:
            # A receiver that loses its fix for a while still counts on; one that was restarted knows nothing yet.
            utc_of_boot = before.utc_of_boot if before and boot >= before.boot else None
        self._senders[sender] = _BootTime(boot, received, utc_of_boot)
        self._senders.move_to_end(sender)
        if len(self._senders) > _MOST_SENDERS:
            self._senders.popitem(last=False)

    def dated(self, event: TriggerEvent) -> TriggerEvent:
        """The event with its UTC, where it had none of its own and its sender has told the date."""
        sender = self._senders.get((event.vehicle, event.component))
        if event.utc is not None or event.clock != "boot" or event.source_time is None or sender is None:
            return event
        if sender.utc_of_boot is None:
            return event
        happened = event.source_time
        if event.source is Source.CAMERA_FEEDBACK:
            happened = unwrapped(happened, sender.boot + event.received - sender.received, FEEDBACK_WRAP_S)
        return replace(event, utc=plausible_utc(sender.utc_of_boot + happened))
