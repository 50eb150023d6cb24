"""Options that may be given once, or once for each of several aircraft."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.aircraft_source import AircraftSource

OF_AIRCRAFT = re.compile(r"([0-9]{1,3})=(.*)", re.ASCII | re.DOTALL)


def add_sources(parser: argparse.ArgumentParser) -> None:
    """Add where frames come from."""
    told = "folder in which the camera's files appear; of several aircraft, each its own: --watch 1=DIR --watch 2=DIR"
    parser.add_argument("--watch", action="append", metavar="[ID=]DIR", help=told)
    told = "live stream instead, a frame of it for each trigger; that of one of several aircraft: --rtsp 2=URL"
    parser.add_argument("--rtsp", action="append", metavar="[ID=]URL|auto", help=told)


def add_recorded_frames(parser: argparse.ArgumentParser) -> None:
    """Add where the frames of a recorded flight are."""
    told = "folder of the flight's pictures; of several aircraft, each its own: --frames 1=DIR --frames 2=DIR"
    parser.add_argument("--frames", action="append", required=True, metavar="[ID=]DIR", help=told)


def add_vehicles(parser: argparse.ArgumentParser) -> None:
    """Add whose triggers count."""
    told = "MAVLink system id of the aircraft; may be repeated, then the triggers of all of them count"
    parser.add_argument("--vehicle", type=int, action="append", metavar="ID", help=told)
    told = "all: the triggers of every aircraft count, not those of one that is followed"
    parser.add_argument("--vehicles", choices=["all"], help=told)


def of_each_aircraft(given: argparse.Namespace) -> argparse.Namespace:
    """The arguments with `--vehicle`, `--vehicles` and where frames come from as the settings have them. Raises UsageError."""
    words = vars(given)
    if given.command not in (None, "replay"):
        return given
    sources = _recorded(words["frames"]) if given.command == "replay" else _live(words)
    return argparse.Namespace(**words | _several(words["vehicle"] or [], words["vehicles"]) | sources)


def _recorded(frames: Sequence[str]) -> dict[str, object]:
    """`frames` is None where each aircraft has its own."""
    whole, folders = _apart("--frames", frames)
    if folders and whole is not None:
        raise _unnamed(f"--frames {whole}", "--frames")
    sources = [_source(one, "frames", watch=folder) for one, folder in folders]
    return {"frames": None if whole is None else Path(whole), "sources": _one_each(sources) or None}


def _live(words: Mapping[str, Any]) -> dict[str, object]:
    watch, folders = _apart("--watch", words["watch"] or ())
    rtsp, streams = _apart("--rtsp", words["rtsp"] or ())
    if watch is not None and rtsp is not None:
        raise UsageError(
            "argument --rtsp: not allowed with argument --watch, unless each names its aircraft: --watch 1=DIR"
        )
    if (folders or streams) and (watch is not None or rtsp is not None):
        raise _unnamed(f"--watch {watch}" if watch is not None else "--rtsp", "--watch")
    sources = [_source(one, "watch", watch=folder) for one, folder in folders]
    sources += [_source(one, "rtsp", rtsp=url) for one, url in streams]
    return {"watch": watch, "rtsp": rtsp, "sources": _one_each(sources) or None}


def _one_each(sources: list[AircraftSource]) -> list[AircraftSource]:
    named = [source.vehicle for source in sources]
    if twice := {vehicle for vehicle in named if named.count(vehicle) > 1}:
        raise UsageError(f"aircraft {min(twice)} was given more than one folder or stream: give each aircraft one")
    return sources


def _unnamed(what: str, option: str) -> UsageError:
    return UsageError(f"{what} names no aircraft, others do: name that of each, as in {option} 1=DIR {option} 2=DIR")


def _several(named: Sequence[int], every: str | None) -> dict[str, object]:
    """One is followed; of several all count."""
    if named and every:
        raise UsageError("--vehicles all: leave out --vehicle, or name all that are to count by it")
    if len(set(named)) == 1:
        return {"vehicle": named[0], "vehicles": []}
    return {"vehicle": None, "vehicles": [every] if every else list(named) or None}


def _apart(option: str, values: Sequence[str]) -> tuple[str | None, list[tuple[int, str]]]:
    """The value that is for all, and those for one aircraft each. Raises UsageError."""
    found = [OF_AIRCRAFT.fullmatch(value) for value in values]
    whole = [value for value, match in zip(values, found, strict=True) if match is None]
    if len(whole) > 1:
        raise UsageError(
            f"{option} was given more than once: for several aircraft name each, as in {option} 1={whole[0]}"
        )
    return next(iter(whole), None), [(int(match[1]), match[2]) for match in found if match is not None]


def _source(vehicle: int, option: str, *, watch: str | None = None, rtsp: str | None = None) -> AircraftSource:
    if not (watch or rtsp):  # as of a shell's variable that is not set
        raise UsageError(f"--{option} {vehicle}= names no folder or stream: write it behind the sign")
    try:
        return AircraftSource(vehicle=vehicle, watch=watch, rtsp=rtsp)
    except ValueError as error:
        raise UsageError(f"--{option}: {error}") from None
