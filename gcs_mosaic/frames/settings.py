"""Settings of the watched folder, and parsing of `--from`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.integrity import MAX_PIXELS

_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderSettings:
    """How a folder is watched. Times are in seconds."""

    poll_s: float = 0.03
    """Time between two scans, less after one that found a new or changed file; a file is accepted at the second scan that
    finds it unchanged. Scanning 5,000 files takes 30 ms, and scans use at most a tenth of the time."""
    from_age_s: float = 1800.0
    """Files older than this when the watch starts are ignored: half an hour for setting up."""
    damaged_after_s: float = 5.0
    """A file of which more may come and that has been unchanged this long is decoded: it is taken if its picture is whole, else
    reported as damaged. Slow links pause."""
    recheck_longest_s: float = 30.0
    """A damaged file is rechecked at increasing intervals, at most this: some systems show changes late."""
    max_pixels: int = MAX_PIXELS
    """Width times height; larger images are refused by their header, before decoding."""
    max_file_bytes: int = 1 << 30
    """Larger files are not read at all: 1 GiB is ten times the largest frame of any airborne camera."""
    cameras: tuple[str, ...] = ()
    """Patterns of file names, such as *_T.*: only these are mapped; none: where several cameras take each shot, one of them."""
    bands: Literal["together", "one"] = "together"
    """Bands of one shot in files of their own (RedEdge, Sequoia): one frame of several bands, registered by pixels, or one band
    alone, as where the time for it is short. Where they cannot be registered, or `cameras` chooses, one band is mapped."""


def parse_from(text: str) -> float:
    """Maximum file age in seconds: `now` (0), `start` (all existing files), or a duration such as 30m."""
    words = {"now": 0.0, "start": math.inf}
    duration = re.fullmatch(r"(\d+(?:\.\d+)?)([smhd])", text.strip().lower(), re.ASCII)
    if duration:
        return float(duration[1]) * _SECONDS[duration[2]]
    if text.strip().lower() in words:
        return words[text.strip().lower()]
    raise UsageError(
        f"--from {text!r} is not understood: give now (only what comes from now on), start (every file that is there) "
        "or how far back, such as 30m or 2h."
    )
