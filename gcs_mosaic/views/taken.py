"""When frames were taken: by the camera's own clock, else as the message said that announced them; else when their files came.

For whoever looks at the map; nothing else goes by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs_mosaic.frames.exif import captured_in
from gcs_mosaic.store import inside
from gcs_mosaic.store.originals import place_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from gcs_mosaic.stitch.arrays import Array
    from gcs_mosaic.store.records import FrameRecord, PositionRecord

KEPT = 200_000  # times in memory

Clock = Literal["camera", "message", "file"]


@dataclass(frozen=True, slots=True)
class CaptureTime:
    """Seconds since 1970. `by`: the camera's clock, whose zone is not known, as if it showed UTC; a message; or nothing better
    than the file's own time, which is when it came."""

    s: float
    by: Clock

    def iso(self, timespec: str = "milliseconds") -> str:
        """ISO 8601; without a zone where the clock tells none."""
        zone = "" if self.by == "camera" else "Z"
        return datetime.fromtimestamp(self.s, UTC).isoformat(timespec=timespec).replace("+00:00", zone)

    def words(self) -> str:
        """For people: when, and by whose clock."""
        at = self.iso("seconds")
        match self.by:
            case "camera":
                return f"taken {at} by the camera's clock"
            case "message":
                return f"taken {at}"
            case "file":
                return f"came {at} by its file"


class TakenTimes:
    """When the frames of a flight's folder were taken. Thread-safe."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._by_camera = lru_cache(KEPT)(self._in_original)

    def of(self, frame: FrameRecord | PositionRecord, told: float | None) -> CaptureTime | None:
        """A frame's; `told`: what a message says, seconds since 1970. None where nothing is known."""
        camera = self._by_camera(frame.original, frame.content_hash)
        if camera is not None:
            return CaptureTime(camera, "camera")
        if told is not None:
            return CaptureTime(told, "message")
        return None if frame.modified is None else CaptureTime(frame.modified, "file")

    def by_one_clock(self, frames: Sequence[PositionRecord], told: Mapping[int, float]) -> Array:
        """Of frames (n,), seconds to compare them by: of the best clock that has all of them, else when they came; NaN where
        nothing is known. `told` by the frames' numbers."""
        times = [self.of(one, told.get(one.number)) for one in frames]
        clocks = {one.by for one in times if one is not None}
        if clocks == {"camera"}:
            found = [one and one.s for one in times]
        elif frames and all(one.number in told for one in frames):
            found = [told[one.number] for one in frames]
        else:
            found = [one.modified for one in frames]
        return np.array([np.nan if one is None else one for one in found], np.float64)

    def _in_original(self, original: str | None, _content_hash: str | None) -> float | None:
        path = original and place_of(self._root, original)
        return captured_at(path, self._root) if path else None


def captured_at(path: Path, root: Path) -> float | None:
    """By the camera's clock, as if it showed UTC; None for a file that does not tell."""
    try:
        with inside.reading(path, root) as file:
            return captured_in(file)
    except OSError:
        return None
