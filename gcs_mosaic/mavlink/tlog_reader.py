"""Reads a recorded link (.tlog) through the same listener as a live one, on the recording's own time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.clock import plausible_utc
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.settings import AircraftIds, LinkSettings
from gcs_mosaic.mavlink.tlog import on_one_clock, read_tlog
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import Notice, TriggerEvent

_LEAP_S = 2.0  # tolerated disorder of a recording's timestamps: several links are written with a slight delay


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedLink:
    """Events and notices of a recording. All times are in seconds since its first packet."""

    heard: list[tuple[float, TriggerEvent | Notice]]  # in order; the events' `received` is on this clock too
    seconds: float  # to the last packet
    packets: int
    began_utc: float | None  # seconds since 1970; None if the recording's clock was not set or jumped

    @property
    def events(self) -> list[TriggerEvent]:
        return [item for _, item in self.heard if isinstance(item, TriggerEvent)]


def read_recording(
    path: Path, settings: LinkSettings, read: Callable[[int], None] = lambda size: None, aircraft: AircraftIds = ()
) -> RecordedLink:
    """Read the whole recording at `path`; `read` is called with the number of bytes read so far. The triggers of all `aircraft`
    count, or, if there are none, those of the one that `settings` choose.

    Raises UsageError if the file is missing or contains no MAVLink.
    """
    try:
        with path.open("rb") as file:
            recorded = _Recorded(path, settings, aircraft or settings.aircraft)
            for arrival in on_one_clock(recorded.noting_utc(read_tlog(file)), start=0.0):
                recorded.hear(arrival)
                read(file.tell())
    except OSError as error:
        raise UsageError(
            f"the recording {str(path)!r} cannot be read ({error.strerror}): give a .tlog file that exists."
        ) from error
    if not recorded.packets:
        raise UsageError(
            f"{str(path)!r} holds no MAVLink packet: give a recording (.tlog) as MAVProxy, Mission Planner, "
            "QGroundControl or gcs-mosaic --record write it."
        )
    return recorded.link()


class _Recorded:
    def __init__(self, path: Path, settings: LinkSettings, aircraft: AircraftIds) -> None:
        address, choice = LinkAddress(kind="file", path=path), VehicleChoice(settings)
        choice.count(aircraft)
        self._listener = Listener(address, settings, choice, 0.0, 0.0)
        self._heard: list[tuple[float, TriggerEvent | Notice]] = []
        self._first_utc = self._last_utc = self._seconds = 0.0
        self.packets = 0

    def noting_utc(self, recorded: Iterator[tuple[float, object]]) -> Iterator[tuple[float, object]]:
        for utc, message in recorded:
            self._first_utc = self._first_utc if self.packets else utc
            self._last_utc = utc
            self.packets += 1
            yield utc, message

    def hear(self, arrival: Arrival) -> None:
        self._seconds = arrival.received
        self._note(self._listener.tick(arrival.received))
        self._note(self._listener.hear(arrival.message, arrival.received))

    def _note(self, said: Iterable[object]) -> None:
        """Triggers that were held back, until it was known whom to follow, keep their own times."""
        for item in said:
            if isinstance(item, TriggerEvent | Notice):
                self._heard.append((item.received if isinstance(item, TriggerEvent) else self._seconds, item))

    def link(self) -> RecordedLink:
        self._note(item for item in self._listener.farewell(self._seconds) if isinstance(item, TriggerEvent))
        self._heard.sort(key=lambda one: one[0])
        runs_through = abs(self._last_utc - self._first_utc - self._seconds) <= _LEAP_S
        return RecordedLink(
            heard=self._heard,
            seconds=self._seconds,
            packets=self.packets,
            began_utc=plausible_utc(self._first_utc) if runs_through else None,
        )
