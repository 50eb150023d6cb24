"""Short messages (STATUSTEXT) to the operator at the ground station, if announcing is enabled."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gcs_mosaic.mavlink.announcements import Announcement, Topic
from gcs_mosaic.mavlink.speaker import Speaker
from gcs_mosaic.messages import Notice
from gcs_mosaic.messages import Topic as About
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.triggers import Missing


class Announcements:
    """Selects what to announce and sends it through the `speakers` of all links (none by default)."""

    def __init__(self, speakers: Sequence[Speaker] = ()) -> None:
        self._speakers = speakers
        self._overlapping: dict[int | None, bool] = {}  # by aircraft, once a frame of it has overlapped the map
        self._missing = 0

    def frame(self, state: FrameState, vehicle: int | None = None) -> None:
        """A frame of this aircraft was processed: does its flight still overlap the map?"""
        whose = "" if vehicle is None else f"aircraft {vehicle}: "
        if state is FrameState.WAITING and self._overlapping.get(vehicle):
            self._overlapping[vehicle] = False
            self._tell(f"overlap {whose}", f"Mosaic: {whose}overlap lost{'' if whose else ', frames match nothing'}")
        elif state in (FrameState.PLACED, FrameState.COVERED):
            if self._overlapping.get(vehicle) is False:
                self._tell(f"overlap {whose}", f"Mosaic: {whose}overlap is back", warning=False)
            self._overlapping[vehicle] = True

    def missing(self, events: Iterable[Missing]) -> None:
        """Announce shots without a frame."""
        for event in events:
            self._missing += 1
            number = event.event.sequence
            shots = "shot" if self._missing == 1 else "shots"
            last = "" if number is None else f", last: {number}"
            self._tell("frames", f"Mosaic: {self._missing} {shots} without frame{last}")

    def notice(self, notice: Notice) -> None:
        """Announce a notice, if important enough."""
        if notice.topic is About.DISK and notice.level != "info":
            bad = notice.level == "error"
            self._tell("disk", "Mosaic: the disk cannot be written" if bad else "Mosaic: the disk is filling up")

    def _tell(self, topic: Topic, text: str, *, warning: bool = True) -> None:
        for speaker in self._speakers:
            speaker.tell(Announcement(topic, text, warning))
