"""Reads a recorded link (.tlog) through the same listener as a live one, on the recording's own time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.clock import plausible_utc
from gcs_mosaic.mavlink.flight_logs import FlightLog, read_dataflash, read_ulog
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.recording_kind import kind_of
from gcs_mosaic.mavlink.settings import AircraftIds, LinkSettings
from gcs_mosaic.mavlink.tlog import TIME, on_one_clock, read_tlog
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
    """Read the whole recording at `path`, a telemetry log or one of the autopilot's own.

    `read` is called with the number of bytes read so far. The triggers of all `aircraft` count, or, if there are none, those
    of the one that `settings` choose.

    Raises UsageError if the file is missing, or none of these.
    """
    try:
        if (kind := kind_of(path)) != "tlog":
            return _of_autopilot(
                read_ulog(path) if kind == "ulog" else read_dataflash(path, text=kind == "dataflash text")
            )
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
    return recorded.link(path.stat().st_size)


def _of_autopilot(log: FlightLog) -> RecordedLink:
    heard: list[tuple[float, TriggerEvent | Notice]] = [(event.received, event) for event in log.events]
    if log.said:
        heard.insert(0, (0.0, Notice(source="replay", level="warning", text=log.said)))
    return RecordedLink(heard=heard, seconds=log.seconds, packets=log.packets, began_utc=log.began_utc)


class _Recorded:
    def __init__(self, path: Path, settings: LinkSettings, aircraft: AircraftIds) -> None:
        address, choice = LinkAddress(kind="file", path=path), VehicleChoice(settings)
        choice.count(aircraft)
        self._listener = Listener(address, settings, choice, 0.0, lambda: 0.0)
        self._heard: list[tuple[float, TriggerEvent | Notice]] = []
        self._first_utc = self._last_utc = self._seconds = 0.0
        self.packets = self._bytes = 0

    def noting_utc(self, recorded: Iterator[tuple[float, MavMessage]]) -> Iterator[tuple[float, MavMessage]]:
        for utc, message in recorded:
            self._first_utc = self._first_utc if self.packets else utc
            self._last_utc = utc
            self.packets += 1
            self._bytes += TIME.size + len(message.get_msgbuf())
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

    def link(self, size: int) -> RecordedLink:
        """All that was heard; `size` of the file tells how much of it could not be read."""
        if (lost := size - self._bytes) > 0:
            text = (
                f"{lost} of {size} bytes of the recording are no whole packets, cut or damaged: the others are replayed"
            )
            self._heard.append((0.0, Notice(source="replay", level="warning", text=text)))
        self._note(item for item in self._listener.farewell(self._seconds) if isinstance(item, TriggerEvent))
        self._heard.sort(key=lambda one: one[0])
        runs_through = abs(self._last_utc - self._first_utc - self._seconds) <= _LEAP_S
        return RecordedLink(
            heard=self._heard,
            seconds=self._seconds,
            packets=self.packets,
            began_utc=plausible_utc(self._first_utc) if runs_through else None,
        )
