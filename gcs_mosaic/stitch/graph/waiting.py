"""Frames that match nothing yet, and which ground has become known since each of them was last tried."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_mosaic.stitch.transaction import Kept

TURN_AFTER = 8  # newly placed frames after which a waiting one is tried again with the likeliest of them


class WaitingFrames(Kept):
    """Remembers who waits. Iterates over them in the order in which they came."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}  # by waiting frame: how many placed frames it has been compared with
        self._placed: list[int] = []  # in the order in which they were placed

    def __iter__(self) -> Iterator[int]:
        return iter(list(self._known))

    def __contains__(self, frame: int) -> bool:
        return frame in self._known

    def __len__(self) -> int:
        return len(self._known)

    def add(self, frame: int) -> None:
        """A frame that has been compared with all that are placed so far."""
        self._known[frame] = len(self._placed)

    def remove(self, frame: int) -> None:
        """It waits no more; one that does not wait is let be."""
        self._known.pop(frame, None)

    def note_placed(self, frame: int) -> None:
        """Another frame has found its place: ground that those who wait have not been compared with."""
        self._placed.append(frame)

    def forget_comparisons(self) -> None:
        """Islands have been joined: what was too little on either may be enough now."""
        self._known = dict.fromkeys(self._known, 0)

    def next_turn(self) -> tuple[int, list[int]] | None:
        """The frame that most new ground has been waiting for, and the frames placed since it was last compared.

        None while there is too little new for any. The frame counts as compared from now on.
        """
        if not self._known:
            return None
        frame = min(self._known, key=self._known.__getitem__)
        if len(self._placed) - self._known[frame] < TURN_AFTER:
            return None
        return frame, self.take_new(frame)

    def take_new(self, frame: int) -> list[int]:
        """The frames placed since this one was last compared; it counts as compared from now on."""
        new = self._placed[self._known[frame] :]
        self._known[frame] = len(self._placed)
        return new
