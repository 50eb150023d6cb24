"""Originals that are not kept, sought where they may still be had: in the watched folder, by their hash.

They were deleted with the output folder, there was no room for them, or they could not be read when their turn came.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from gcs_mosaic.messages import Frame
from gcs_mosaic.store.originals import KeptOriginal, NotKept, Originals, is_intact, read_intact

logger = logging.getLogger(__name__)

AGAIN_S = 30.0  # after all have been tried in vain
Elsewhere = Callable[[str], Path | None]


class LostOriginals:
    """Frames without an original. `elsewhere(name)`: where the frame's file was found, if anywhere."""

    def __init__(self, originals: Originals, elsewhere: Elsewhere) -> None:
        self._originals = originals
        self._elsewhere = elsewhere
        self._frames: deque[Frame] = deque()
        self._in_vain = 0  # tries since the last one that succeeded
        self._due = -math.inf

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frames: Iterable[Frame]) -> None:
        known = {frame.name for frame in self._frames}
        self._frames.extend(replace(frame, data=None) for frame in frames if frame.name not in known)
        self.seek_now()

    @property
    def names(self) -> list[str]:
        """Of those that are sought."""
        return [frame.name for frame in self._frames]

    def seek_now(self) -> None:
        """Try all once more at once, whatever was tried in vain before."""
        self._in_vain, self._due = 0, -math.inf

    def forget(self, name: str) -> None:
        """This one is not sought any more."""
        self._frames = deque(frame for frame in self._frames if frame.name != name)

    def is_due(self, now: float) -> bool:
        """Whether to try the next one at this monotonic time."""
        return bool(self._frames) and now >= self._due

    def next(self, now: float) -> tuple[Frame, KeptOriginal | NotKept | None]:
        """Try the next one, which must be due; None: it was not found."""
        frame = self._frames[0]
        kept = self.keep(frame)
        self._frames.popleft()
        if isinstance(kept, KeptOriginal):
            self._in_vain = 0
            return frame, kept
        self._frames.append(frame)
        self._in_vain += 1
        if self._in_vain >= len(self._frames) or (kept is not None and kept.for_lack_of_room):
            self._in_vain, self._due = 0, now + AGAIN_S
        return frame, kept

    def keep(self, frame: Frame) -> KeptOriginal | NotKept | None:
        """Keep this one now; None if it is not found."""
        found = self.found(frame)
        return None if found is None else self._originals.keep(replace(frame, path=found))

    def read(self, name: str, content_hash: str) -> bytes | None:
        """The frame's file as it came, from where it lies now outside the output folder. From any thread."""
        path = self._elsewhere(name)
        return read_intact(path, content_hash) if path is not None and path.is_file() else None

    def found(self, frame: Frame) -> Path | None:
        """Where the frame's file, unchanged, lies now outside the output folder."""
        path = self._elsewhere(frame.name)
        return path if path is not None and path.is_file() and is_intact(path, frame.content_hash) else None
