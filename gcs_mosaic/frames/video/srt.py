"""Positions in subtitles beside a video, as DJI's cameras write them (FLIGHT.SRT beside FLIGHT.MP4).

Two forms are in use. The older one: `GPS(14.6060,50.0790,15)` or `GPS (14.6060, 50.0790, 15)`, longitude first, then the number
of satellites, with the height as `BAROMETER:1.9` or `H 6.00m`. The newer one: `[latitude: 50.0790] [longitude: 14.6060]
[rel_alt: 1.300 abs_alt: 208.713]`; some firmware writes `longtitude`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from gcs_mosaic.frames.video.track import Track, position_of
from gcs_mosaic.messages import Position

MOST_BYTES = 256 << 20  # nine hours of 30 a second have 250 MB
LONGEST_LINE = 4096
_CUE = re.compile(r"\s*(\d+):(\d\d?):(\d\d?)[,.](\d{1,3})\s*-->", re.ASCII)
_NUMBER = r"\s*([-+]?\d{1,5}(?:\.\d{1,15})?)"
_OLD = re.compile(rf"GPS\s*\({_NUMBER}\s*,{_NUMBER}\s*,", re.ASCII)
_LATITUDE = re.compile(rf"latitude\s*:{_NUMBER}", re.ASCII | re.IGNORECASE)
_LONGITUDE = re.compile(rf"longt?itude\s*:{_NUMBER}", re.ASCII | re.IGNORECASE)
_ALTITUDE = re.compile(rf"(?:abs_alt|altitude|BAROMETER)\s*:{_NUMBER}", re.ASCII)


def subtitles_beside(video: Path) -> Path | None:
    """The subtitle file of the same name beside a video, whatever the case of its ending; links are not followed."""
    for name in (video.with_suffix(".SRT"), video.with_suffix(".srt"), video.with_suffix(".Srt")):
        if name.is_file() and not name.is_symlink():
            return name
    return None


def read_subtitles(path: Path) -> Track:
    """The positions in a subtitle file; empty if it has none. Raises OSError."""
    track, seconds = Track(by=path.name), None
    if path.stat().st_size > MOST_BYTES:
        return track
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), encoding="utf-8", errors="replace") as file:
        while line := file.readline(LONGEST_LINE):
            if cue := _CUE.match(line):
                hours, minutes, whole = int(cue[1]), int(cue[2]), int(cue[3])
                seconds = (hours * 60 + minutes) * 60 + whole + int(cue[4].ljust(3, "0")) / 1000
            elif seconds is not None:
                track.add(seconds, _position(line))
    return track


def _position(line: str) -> Position | None:
    altitude = _ALTITUDE.search(line)
    height = float(altitude[1]) if altitude else None
    latitude, longitude = _LATITUDE.search(line), _LONGITUDE.search(line)
    if latitude and longitude:
        return position_of(float(latitude[1]), float(longitude[1]), height)
    old = _OLD.search(line)
    return position_of(float(old[2]), float(old[1]), height) if old else None
