"""Tells the operator when the map falls behind the camera, and when it has caught up."""

from __future__ import annotations

from gcs_mosaic.messages import Notice
from gcs_mosaic.store.status import Behind

SAID_FROM_S = 10.0  # behind: less is a burst of the camera


class Backlog:
    """Notices of one flight: one as the map falls behind, another each time that has doubled, one when it has caught up."""

    def __init__(self) -> None:
        self._said_s = 0.0  # 0: not behind

    def notice(self, behind: Behind) -> Notice | None:
        """What is to be said of the present backlog, if anything."""
        if self._said_s and not behind.frames:
            self._said_s = 0.0
            return Notice(source="daemon", level="info", text="the map has caught up: every frame has had its turn")
        if behind.seconds < max(SAID_FROM_S, 2 * self._said_s):
            return None
        self._said_s = behind.seconds
        text = f"the map is {behind.frames} frames, {behind.seconds:.0f} s behind: the newest are stitched first"
        return Notice(source="daemon", level="warning", text=text)
