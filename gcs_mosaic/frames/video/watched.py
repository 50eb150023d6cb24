"""Videos that end up in a watched folder: read once they stand still, and read on where they have grown since."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.frames.video.names import clock_of
from gcs_mosaic.frames.video.reading import NEEDED, Item, Known, VideoReading, can_read_videos
from gcs_mosaic.messages import Frame, Notice

STILL_S = 2.0  # without a change: cameras and copies write every second at least
MOST_WAITING = 16  # frames, before a video is read on: what is newer than they are waits for nothing
AT_ONCE = 4  # frames between two looks at the folder: pictures in it are not to wait for a video
LOOKS_AT_REFUSED = 2  # at a file that is no video, before it is said


class Room:
    """How many frames the flight has room for. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting = self._given = 0

    def note(self, waiting: int) -> None:
        """For the flight: so many frames wait now."""
        with self._lock:
            self._waiting, self._given = waiting, 0

    def take(self) -> None:
        """For a source: one more is given."""
        with self._lock:
            self._given += 1

    @property
    def is_there(self) -> bool:
        with self._lock:
            return self._waiting + self._given < MOST_WAITING


@dataclass(slots=True)
class _File:
    """A video as it was last seen. `read`: signature of what has been read of it; `looks`: at what cannot be read."""

    look: Look
    unchanged_since: float
    read: tuple[int, ...] | None = None
    looks: int = 0
    next_look: float = 0.0
    is_said: bool = False


class WatchedVideos:
    """All videos of a folder; one is read at a time, the oldest first. `known`: frames that a resumed flight has already, by
    video.

    For use by one thread.
    """

    def __init__(
        self, settings: FolderSettings, stream: StreamSettings, known: Mapping[str, Known], room: Room | None = None
    ) -> None:
        self._settings, self._stream, self._room = settings, stream, room or Room()
        self._known = {name: dict(frames) for name, frames in known.items()}
        self._files: dict[str, _File] = {}
        self._reading: VideoReading | None = None
        self._is_first, self._said_needed = True, False
        self.left = 0
        """How many were left alone, because they are older than the flight."""

    def items(self, looks: Sequence[Look], oldest_ns: float, now: float) -> Iterator[Item]:
        """What comes of the videos that are there at the monotonic time `now`; those older than `oldest_ns` at the first look are
        left alone."""
        self._note(looks, oldest_ns, now)
        if self._reading is None and self._room.is_there:
            yield from self._begin(now)
        if self._reading is not None:
            yield from self._read(self._reading, now)

    @property
    def reading(self) -> str:
        """Which one is being read, and how far it has come, for display; empty if none is."""
        one = self._reading
        if one is None or one.described is None:
            return ""
        length = one.described.duration_s
        return f"{one.look.name}, {clock_of(one.at_s)}{f' of {clock_of(length)}' if length else ''}"

    def close(self) -> str:
        """End; returns what to say of a video that is not read to its end."""
        reading, self._reading = self._reading, None
        if reading is None:
            return ""
        reading.close()
        return f"{reading.look.name} is read up to {clock_of(reading.at_s)}: --resume goes on with it"

    def _note(self, looks: Sequence[Look], oldest_ns: float, now: float) -> None:
        for look in looks:
            known = self._files.get(look.name)
            if known is None:
                self._files[look.name] = known = _File(look, now)
                if self._is_first and look.modified_ns < oldest_ns and look.name not in self._known:
                    known.read, self.left = look.signature, self.left + 1
            elif known.look.signature != look.signature:
                known.look, known.unchanged_since, known.looks, known.next_look = look, now, 0, 0.0
        self._is_first = False

    def _begin(self, now: float) -> Iterator[Notice]:
        ready = [one for one in self._files.values() if self._is_ready(one, now)]
        if not ready:
            return
        if not can_read_videos():
            if not self._said_needed:
                self._said_needed = True
                yield Notice(source="video", level="warning", text=NEEDED)
            return
        file = min(ready, key=lambda one: (one.look.modified_ns, one.look.name))
        known = self._known.get(file.look.name, {})
        self._reading = VideoReading(file.look, self._stream, self._settings.max_pixels, known)

    def _is_ready(self, file: _File, now: float) -> bool:
        return file.read != file.look.signature and now >= max(file.unchanged_since + STILL_S, file.next_look)

    def _read(self, reading: VideoReading, now: float) -> Iterator[Item]:
        given = 0
        while given < AT_ONCE and self._room.is_there and not reading.is_over:
            came = False
            for item in reading.items(0.0):
                came = True
                yield item
                if isinstance(item, Frame):
                    self._room.take()
                    given += 1
                    break
            if not came:
                break
        if reading.is_over:
            self._reading = None
            yield from self._over(reading, now)

    def _over(self, reading: VideoReading, now: float) -> Iterator[Notice]:
        reading.close()
        file = self._files[reading.look.name]
        if not reading.refused:
            self._known[reading.look.name] = reading.known
            file.read, file.is_said = reading.look.signature, False
            return
        file.looks += 1
        file.next_look = now + self._settings.damaged_after_s
        if file.looks >= LOOKS_AT_REFUSED:
            file.read = reading.look.signature
            if not file.is_said:
                file.is_said = True
                text = f"{reading.look.name} is passed over: {reading.refused}"
                yield Notice(source="video", level="warning", text=text)
