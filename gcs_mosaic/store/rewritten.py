"""Files that were written again with the same picture: what they are called, and their old originals until nobody reads them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gcs_mosaic.store import inside
from gcs_mosaic.store.records import FrameRecord, FrameState

logger = logging.getLogger(__name__)


class RewrittenFiles:
    """Of one flight."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}  # frame names, by the names under which the same picture came again
        self._outdated: list[tuple[str, Path]] = []

    def note(self, again: str, name: str) -> None:
        """What came as `again` is the frame `name`."""
        self._first[again] = name

    def first(self, name: str) -> str:
        """The frame that came under this name."""
        return self._first.get(name, name)

    def outdated(self, name: str, path: Path) -> None:
        """This is not the original of the frame any more."""
        self._outdated.append((name, path))

    def remove_outdated(self, folder: Path, frames: Callable[[FrameState], list[FrameRecord]]) -> None:
        """Remove old originals in `folder`, but for those of frames that are still to be decoded."""
        if not self._outdated:
            return
        pending = {frame.name for frame in frames(FrameState.PENDING)}
        due = [path for name, path in self._outdated if name not in pending]
        self._outdated = [one for one in self._outdated if one[0] in pending]
        for path in due:
            if path.is_relative_to(folder):
                with suppress(OSError):  # gone, or on a disk that is lost: a stray file harms nothing
                    inside.remove(path, folder)
