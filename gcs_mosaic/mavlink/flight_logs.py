"""Camera events in the logs that autopilots keep themselves: ArduPilot's .BIN or .log (DataFlash), PX4's .ulg (ULog).

Read with pymavlink's DFReader and pyulog. ArduPilot logs TRIG when it triggers and CAM when the picture is taken (or when it
triggers, without a feedback pin); PX4 logs camera_trigger and camera_capture. Sources: ArduPilot's LogStructure.h, PX4's
msg/CameraTrigger.msg and CameraCapture.msg.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.clock import plausible_utc
from gcs_mosaic.messages import CaptureResult, Position, Source, TriggerEvent

os.environ.setdefault("PYMAVLINK_FAST_INDEX", "0")  # the fast one prints where nobody can keep it from the terminal

_SOURCES = {"TRIG": Source.CAMERA_TRIGGER, "CAM": Source.CAMERA_FEEDBACK}
_TOPICS = {"camera_trigger": Source.CAMERA_TRIGGER, "camera_capture": Source.IMAGE_CAPTURED_BY_AUTOPILOT}
_UTC_TOPICS = {"vehicle_gps_position": "time_utc_usec", "sensor_gps": "time_utc_usec"}
_NO_LENGTH = re.compile(
    rb"\xa3\x95\x80.[\x00-\x02]", re.DOTALL
)  # a format of no length, on which the reader would stay


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLog:
    """Events in order, their times in seconds since the log began. `began_utc`: None if the log knows no date. `said`: what
    could not be read."""

    events: list[TriggerEvent]
    seconds: float
    packets: int
    began_utc: float | None
    said: str = ""


def read_dataflash(path: Path, *, text: bool) -> FlightLog:
    """An ArduPilot log. Raises OSError, and UsageError if it is none."""
    from pymavlink import DFReader

    if not text and _NO_LENGTH.search(path.read_bytes()):
        raise _damaged(path, "it holds a format of no length")
    reader = DFReader.DFReader_text if text else DFReader.DFReader_binary
    log: Any = reader.__new__(reader)  # so that its file can be closed if it does not come up
    with _quiet(path):
        try:
            log.__init__(str(path))
            first, last = _first_and_last(log)
            log.rewind()
            told = [(message._timestamp, _of_dataflash(message)) for message in _camera_messages(log)]
            cut = not text and _is_cut(log)
        finally:
            if (file := getattr(log, "filehandle", None)) is not None:
                file.close()
    events = [_moved(event, at - first) for at, event in told]
    return FlightLog(
        events=sorted(events, key=lambda event: event.received),
        seconds=max(last - first, *(event.received for event in events), 0.0),
        packets=int(log._count),
        began_utc=plausible_utc(first),
        said=f"{path.name} ends within a message: what is whole of it is replayed" if cut else "",
    )


@contextlib.contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """What a reader prints is not shown; whatever it raises on a damaged log becomes a UsageError."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            yield
        except OSError:
            raise
        except Exception as error:
            raise _damaged(path, repr(error)) from error


def read_ulog(path: Path) -> FlightLog:
    """A PX4 log. Raises OSError, and UsageError if it is none."""
    from pyulog import ULog

    data = path.read_bytes()
    with _quiet(path):
        log = ULog(io.BytesIO(data), [*_TOPICS, *_UTC_TOPICS])
        rows = [(data.name, row) for data in log.data_list for row in _rows(data.data)]
    first = log.start_timestamp / 1e6
    events = [_of_ulog(_TOPICS[name], row, first) for name, row in rows if name in _TOPICS and not row.get("feedback")]
    cut = (
        f"{path.name} is damaged or cut: what is whole of it is replayed"
        if log.file_corruption or not _ends_whole(data)
        else ""
    )
    return FlightLog(
        events=sorted(events, key=lambda event: event.received),
        seconds=max((log.last_timestamp - log.start_timestamp) / 1e6, *(event.received for event in events), 0.0),
        packets=len(rows),
        began_utc=next((utc for name, row in rows if (utc := _began(name, row, first)) is not None), None),
        said=cut,
    )


def _damaged(path: Path, why: str) -> UsageError:
    return UsageError(
        f"the log {str(path)!r} cannot be read ({why}): give one that is whole, or the .tlog of the flight."
    )


def _camera_messages(log: Any) -> Iterator[Any]:
    while (message := log.recv_match(type=[*_SOURCES])) is not None:
        yield message


def _first_and_last(log: Any) -> tuple[float, float]:
    """Times of the first message that has one and of the last."""
    while (message := log.recv_msg()) is not None and getattr(message, "TimeUS", None) is None:
        pass
    if message is None:
        raise ValueError("no message has a time")
    return float(message._timestamp), float(log.last_timestamp())


def _is_cut(log: Any) -> bool:
    """Whether the last message goes on beyond the end."""
    ends = [log.offsets[kind][-1] + form.len for kind, form in log.formats.items() if len(log.offsets[kind])]
    return bool(ends) and max(ends) > log.data_len


def _ends_whole(ulog: bytes) -> bool:
    """Whether its records (size and kind, then so many bytes) end where the file does; the head has 16 bytes."""
    at = 16
    while at + 3 <= len(ulog):
        at += 3 + int.from_bytes(ulog[at : at + 2], "little")
    return at == len(ulog)


def _of_dataflash(message: Any) -> TriggerEvent:
    source = _SOURCES[message.get_type()]
    latitude, longitude, altitude = (getattr(message, name, 0.0) or 0.0 for name in ("Lat", "Lng", "Alt"))
    return _event(
        source,
        camera=int(getattr(message, "I", 0) or 0),
        sequence=int(message.Img) if hasattr(message, "Img") else None,
        boot_s=message.TimeUS / 1e6,
        result=CaptureResult.TAKEN if source is Source.CAMERA_FEEDBACK else CaptureResult.UNKNOWN,
        position=_position(latitude, longitude, altitude),
    )


def _of_ulog(source: Source, row: dict[str, float], first: float) -> TriggerEvent:
    result = row.get("result")
    taken = (
        CaptureResult.UNKNOWN
        if result is None or result < 0
        else CaptureResult.TAKEN
        if result
        else CaptureResult.FAILED
    )
    event = _event(
        source,
        camera=0,
        sequence=int(row["seq"]) if "seq" in row else None,
        boot_s=row["timestamp"] / 1e6,
        result=taken if source is not Source.CAMERA_TRIGGER else CaptureResult.UNKNOWN,
        position=_position(row.get("lat", 0.0), row.get("lon", 0.0), row.get("alt", 0.0)),
    )
    return _moved(event, row["timestamp"] / 1e6 - first)


def _event(
    source: Source,
    *,
    camera: int,
    sequence: int | None,
    boot_s: float,
    result: CaptureResult,
    position: Position | None,
) -> TriggerEvent:
    return TriggerEvent(
        vehicle=1,
        component=1,
        camera=camera,
        source=source,
        sequence=sequence,
        received=0.0,
        source_time=boot_s or None,
        clock="boot" if boot_s else "none",
        utc=None,
        result=result,
        file_hint=None,
        position=position,
    )


def _moved(event: TriggerEvent, seconds: float) -> TriggerEvent:
    return replace(event, received=max(seconds, 0.0))


def _position(latitude: float, longitude: float, altitude: float) -> Position | None:
    if (latitude, longitude) == (0, 0) or not (abs(latitude) <= 90 and abs(longitude) <= 180):
        return None
    return Position(latitude_deg=float(latitude), longitude_deg=float(longitude), altitude_m=float(altitude))


def _rows(data: dict[str, Any]) -> Iterator[dict[str, float]]:
    for k in range(len(data["timestamp"])):
        yield {name: values[k].item() for name, values in data.items()}


def _began(name: str, row: dict[str, float], first: float) -> float | None:
    """UTC at the log's beginning, by a row that knows it."""
    utc = row.get(_UTC_TOPICS.get(name, "timestamp_utc"), 0) / 1e6
    return plausible_utc(utc - row["timestamp"] / 1e6 + first)
