"""Frames whose files could not be read when their turn came: tried again, because most reasons pass.

A card is pulled out, a mount is lost, too many files are open, the process that decodes was killed for want of memory: the
picture itself is as whole as when it was found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

from gcs_mosaic.app.waiting.prefetch import UndecodableFrame
from gcs_mosaic.messages import Frame

AGAIN_S = 2.0
READ_FAILED = "cannot be read"  # as `frames.decode` begins the reason
PROCESS_FAILED = "could not be decoded"  # as `frames.decoding` does
MOST_TRIES = 3  # of a frame whose process is ended: it may be what brings it down


class UnreadFrames:
    """Frames that wait until their files can be read. `find(frame)`: the frame where its file is whole now, or None."""

    def __init__(self, find: Callable[[Frame], Frame | None]) -> None:
        self._find = find
        self._failed: dict[str, UndecodableFrame] = {}
        self._tries: Counter[str] = Counter()
        self._due = 0.0

    def __len__(self) -> int:
        return len(self._failed)

    def add(self, failed: UndecodableFrame, now: float) -> bool:
        """Whether it waits here from now on: if its file could not be read or its process was ended, not if it is no picture."""
        if not failed.reason.startswith((READ_FAILED, PROCESS_FAILED)):
            return False
        if failed.reason.startswith(PROCESS_FAILED):
            self._tries[failed.frame.name] += 1
            if self._tries[failed.frame.name] > MOST_TRIES:
                return False
        self._failed[failed.frame.name] = failed
        self._due = now + AGAIN_S
        return True

    def readable(self, now: float) -> Iterator[Frame]:
        """Those that can be read now; they no longer wait here."""
        if not self._failed or now < self._due:
            return
        self._due = now + AGAIN_S
        for name, failed in list(self._failed.items()):
            found = self._find(failed.frame)
            if found is not None:
                del self._failed[name]
                yield found

    def rest(self) -> list[UndecodableFrame]:
        """All that still wait; none waits here afterwards."""
        rest, self._failed = list(self._failed.values()), {}
        return rest
