"""The pictures of a flight and their capture times, simulated or from a folder of photographs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from .exif import located_at, taken_at
from .flight import Flight
from .geometry import CameraState
from .messages import state_at

PICTURES = {".jpg", ".jpeg", ".png", ".tif", ".tiff"}
USUAL_INTERVAL = 2.0  # seconds, where the capture times are unknown
LONGEST_PAUSE = 20.0  # seconds: nobody wants to wait for a battery change


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """A picture as stored by the camera: capture time, POSIX path in the watched folder, file content."""

    index: int
    time: float
    name: str
    state: CameraState | None
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """All exposures of a flight, produced lazily by `exposures()`. note: where the times come from."""

    count: int
    seconds: float
    note: str
    exposures: Callable[[], Iterator[Exposure]]


def simulated(flight: Flight, interval: float | None = None) -> Film:
    """The pictures of a simulated flight, at its own times or at a fixed interval."""
    times = [state.time if interval is None else k * interval for k, state in enumerate(flight.states)]

    def exposures() -> Iterator[Exposure]:
        rows = zip(times, flight.names, flight.states, flight.pictures(), strict=True)
        for k, (time, name, state, data) in enumerate(rows):
            yield Exposure(index=k, time=time, name=name, state=state, data=data)

    return Film(count=len(times), seconds=times[-1], note="simulated", exposures=exposures)


def recorded(folder: Path, interval: float | None = None) -> Film:
    """The photographs of a folder in name order. Raises ValueError if there are none."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in PICTURES and path.is_file())
    if not paths:
        raise ValueError(
            f"there are no pictures ({', '.join(sorted(PICTURES))}) in {folder}; give a folder that holds some"
        )
    times, note = times_of(paths, interval)

    def exposures() -> Iterator[Exposure]:
        for k, (time, path) in enumerate(zip(times, paths, strict=True)):
            name = path.relative_to(folder).as_posix()
            yield Exposure(index=k, time=time, name=name, state=state_of(path, time), data=path.read_bytes())

    return Film(count=len(paths), seconds=times[-1], note=note, exposures=exposures)


def state_of(path: Path, time: float) -> CameraState | None:
    """Where a photograph was taken, by its EXIF data; None if they do not tell."""
    place = located_at(path)
    return None if place is None else state_at(time, *place)


def times_of(paths: list[Path], interval: float | None) -> tuple[list[float], str]:
    """Seconds since the first picture, and where they come from."""
    if interval is not None:
        return [k * interval for k in range(len(paths))], f"one every {interval:g} s"
    taken = [taken_at(path) for path in paths]
    known = [moment for moment in taken if moment is not None]
    if len(known) < len(paths):
        return [
            k * USUAL_INTERVAL for k in range(len(paths))
        ], f"one every {USUAL_INTERVAL:g} s, as not all tell their time"
    times = [0.0]
    for before, after in pairwise(known):
        times.append(times[-1] + paused(after - before))
    return times, "at their own times (EXIF)"


def paused(seconds: float) -> float:
    """The interval, bounded: a camera clock set back, or a long pause, must not stall the flight."""
    return min(seconds, LONGEST_PAUSE) if seconds >= 0 else USUAL_INTERVAL
