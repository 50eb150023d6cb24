"""The source of frames of one of several aircraft, and how its frames are told from those of the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

from gcs_mosaic.messages import (
    HIGHEST_SYSTEM,
    DamagedFile,
    DroppedFrame,
    Frame,
    Notice,
    OtherFile,
    SourceReport,
    expected_system,
)

T = TypeVar("T")
File = TypeVar("File", bound=Frame | DamagedFile)


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftSource:
    """Where the frames of one aircraft come from: a folder or a live stream."""

    vehicle: int = 0
    """Its MAVLink system id."""
    watch: str | None = None
    """Folder in which its camera's files appear."""
    rtsp: str | None = None
    """Live stream instead; auto: as announced by this aircraft."""
    cameras: tuple[str, ...] = ()
    """Patterns of the names of its files that are mapped; empty: as `frames.cameras` says."""

    def __post_init__(self) -> None:
        if not 0 < self.vehicle <= HIGHEST_SYSTEM:
            raise ValueError(f"vehicle: {expected_system(self.vehicle)}")
        if (self.watch is None) == (self.rtsp is None):
            given = "neither" if self.watch is None else "both"
            raise ValueError(f"aircraft {self.vehicle}: expected watch: FOLDER or rtsp: ADDRESS, got {given}")


def of_aircraft(
    items: Iterator[T], vehicle: int
) -> Iterator[T | Frame | DamagedFile | DroppedFrame | OtherFile | Notice | SourceReport]:
    """What a source brings, each item marked as that aircraft's."""
    for item in items:
        match item:
            case Frame() | DamagedFile():
                yield marked(item, vehicle)
            case DroppedFrame() | OtherFile():
                yield replace(item, frame=marked(item.frame, vehicle))
            case Notice() | SourceReport():
                yield replace(item, vehicle=vehicle)
            case _:
                yield item


def marked(file: File, vehicle: int) -> File:
    """The same file as that aircraft's."""
    if isinstance(file, Frame) and file.earlier is not None:
        file = replace(file, earlier=name_with(vehicle, file.earlier))
    return replace(file, name=name_with(vehicle, file.name), vehicle=vehicle)


def name_with(vehicle: int, name: str) -> str:
    """A frame's name in a flight of several aircraft: two cameras write files of one name."""
    return f"{vehicle}/{name}"


def name_without(vehicle: int | None, name: str) -> str:
    """The name within its source; `vehicle`: whose frame it is."""
    return name if vehicle is None else name.removeprefix(f"{vehicle}/")
