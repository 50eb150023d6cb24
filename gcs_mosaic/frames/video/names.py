"""Which files are videos, and what their frames are called."""

from __future__ import annotations

import re
from pathlib import Path

from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.frames.scan import VIDEO_SUFFIXES

_SUFFIXES = "|".join(sorted(suffix[1:] for suffix in VIDEO_SUFFIXES))
_FRAME = re.compile(
    rf"(.+\.(?:{_SUFFIXES})(?:#\d+)?)/(\d{{2,4}})(\d\d)(\d\d)\.(\d{{3}})\.jpg", re.DOTALL | re.IGNORECASE
)


def is_video(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() in VIDEO_SUFFIXES


def frame_name(video: str, version: int, ms: int) -> str:
    """Name of the frame at `ms` milliseconds from the beginning: "FLIGHT.MP4/000012.345.jpg" (hours, minutes, seconds)."""
    seconds, ms = divmod(ms, 1000)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{versioned(video, version)}/{hours:02}{minutes:02}{seconds:02}.{ms:03}.jpg"


def video_and_ms(name: str) -> tuple[str, int] | None:
    """Inverse of `frame_name`, the video's name with its version; None for a frame that is of no video."""
    found = _FRAME.fullmatch(name)
    if found is None:
        return None
    hours, minutes, seconds, ms = (int(found[k]) for k in (2, 3, 4, 5))
    return found[1], ((hours * 60 + minutes) * 60 + seconds) * 1000 + ms


def clock_of(seconds: float) -> str:
    """A time within a video for display: 0:12:34."""
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"
