"""Waiting frames: without a match yet, and the ground that became known since each was last tried."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_mosaic.stitch.transaction import Kept

TURN_AFTER = 8  # newly placed frames after which a waiting one is retried with the most similar of them


class WaitingFrames(Kept):
    """The waiting frames. Iterates over them in order of arrival."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}  # by waiting frame: number of placed frames it has been compared with
        self._placed: list[int] = []  # in order of placement

    def __iter__(self) -> Iterator[int]:
        return iter(list(self._known))

    def __contains__(self, frame: int) -> bool:
        return frame in self._known

    def __len__(self) -> int:
        return len(self._known)

    def add(self, frame: int) -> None:
        """Add a frame that has been compared with all frames placed so far."""
        self._known[frame] = len(self._placed)

    def remove(self, frame: int) -> None:
        """Stop waiting for a frame; others are ignored."""
        self._known.pop(frame, None)

    def note_placed(self, frame: int) -> None:
        """Another frame was placed: ground the waiting frames have not been compared with."""
        self._placed.append(frame)

    def forget_comparisons(self) -> None:
        """Islands were merged: too little overlap on either may be enough now."""
        self._known = dict.fromkeys(self._known, 0)

    def next_turn(self) -> tuple[int, list[int]] | None:
        """The waiting frame with most new ground to compare, and the frames placed since its last comparison.

        None while there is too little for any. The frame counts as compared from now on.
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
