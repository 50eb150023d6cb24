"""Uploads that bring a small preview of a picture first, or a part of it that can be decoded (a progressive JPEG), and the whole
picture into the same file later. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.frames.pending_file import file_and_version, versioned
from gcs_mosaic.frames.shot_names import shot_file
from gcs_mosaic.messages import Frame, content_hash

Size = tuple[int, int] | None

MUCH_SMALLER = 0.5  # of the pixels of the camera's largest picture so far: may be a preview
WAIT_S = 5.0  # for the whole picture, after the last change
FINAL_WITHIN_S = (
    60.0  # a larger picture that comes later is another one of a camera that writes one name again and again
)
LOOKED_AT = 1 << 16  # bytes, of the beginning and of the end of what came first
END_MARKER = b"\xff\xd9"


@dataclass(slots=True)
class _Taken:
    size: tuple[int, int]
    picture: str | None
    at: float
    length: int  # bytes that an upload would have brought, without an end marker
    ends: str  # hash of the first and last of them
    captured: float | None
    is_reused: bool  # whether pictures of one size have followed one another under this name


class Previews:
    """Of one folder: what waits because it may be a preview, and what is the whole picture of one that was taken."""

    def __init__(self) -> None:
        self._largest = Counter[str]()  # px, by camera
        self._taken: dict[str, _Taken] = {}  # by file name
        self._waiting: dict[Path, tuple[Frame, tuple[int, int], float]] = {}
        self._overwritten: dict[Path, tuple[Frame, tuple[int, int]]] = {}  # what waited in files that have changed
        self._in_vain = set[tuple[str, tuple[int, int]]]()  # cameras and sizes of small pictures that were frames
        self.again = 0  # files that were written again with the same picture

    def take(self, frame: Frame, size: Size, now: float) -> Iterator[Frame]:
        """The frame, or nothing if it has to wait; if it is the whole picture of a preview that was taken, it says so."""
        self._waiting.pop(frame.path, None)
        before, size_before = self._overwritten.pop(frame.path, (None, None))
        if size is None:
            yield frame
            return
        if before is not None and size_before == size:  # a camera that writes one name again and again
            self._in_vain.add((_camera(frame), size))
            if before.picture is None or before.picture != frame.picture:
                yield self._noted(before, size, now)
                file, version = file_and_version(before.name)
                frame = replace(frame, name=versioned(file, version + 1), earlier=before.name)
        is_small = size[0] * size[1] < MUCH_SMALLER * self._largest[_camera(frame)]
        if is_small and (_camera(frame), size) not in self._in_vain:
            self._waiting[frame.path] = frame, size, now + WAIT_S
            return
        yield self._noted(frame, size, now)

    def changed(self, path: Path) -> None:
        """This file is being written: what waits of it will come again."""
        if waiting := self._waiting.pop(path, None):
            self._overwritten[path] = waiting[:2]

    def due(self, now: float) -> Iterator[Frame]:
        """What has stood still for long enough to be no preview."""
        self._in_vain |= {(_camera(frame), size) for frame, size, until in self._waiting.values() if now >= until}
        for path, (frame, size, _) in list(self._waiting.items()):
            if (_camera(frame), size) in self._in_vain:  # those that came after it need not wait, either
                del self._waiting[path]
                yield self._noted(frame, size, now)

    def _noted(self, frame: Frame, size: tuple[int, int], now: float) -> Frame:
        file, _ = file_and_version(frame.name)
        before = self._taken.get(file)
        data = frame.data or b""
        length = len(data) - 2 * data.endswith(END_MARKER)
        new = _Taken(size, frame.picture, now, length, _ends(data, length), frame.captured, is_reused=False)
        self._taken[file] = new
        self._largest[_camera(frame)] = max(self._largest[_camera(frame)], size[0] * size[1])
        if before is None:
            return frame
        self.again += before.picture is not None and before.picture == frame.picture
        larger = size[0] > before.size[0] and size[1] > before.size[1]
        has_grown = len(data) >= before.length > 0 and _ends(data, before.length) == before.ends
        new.is_reused = before.is_reused or (size == before.size and before.picture != frame.picture and not has_grown)
        is_whole = has_grown or (larger and now - before.at <= FINAL_WITHIN_S and not _is_another(before, new))
        if is_whole:
            self._in_vain.discard((_camera(frame), before.size))
        return replace(frame, is_whole_of_earlier=True) if is_whole else frame


def _is_another(before: _Taken, new: _Taken) -> bool:
    """Whether a larger picture under one name is no whole one of what was there before."""
    if before.captured is not None and new.captured is not None and abs(new.captured - before.captured) >= 1.0:
        return True
    return new.is_reused


def _ends(data: bytes, length: int) -> str:
    return content_hash(data[: min(length, LOOKED_AT)] + data[max(0, length - LOOKED_AT) : length])


def _camera(frame: Frame) -> str:
    return shot_file(file_and_version(frame.name)[0]).camera
