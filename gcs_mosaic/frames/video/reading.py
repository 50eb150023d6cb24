"""A recorded video as the program sees it: read by a process of its own, each frame once, from where an earlier run stopped."""

from __future__ import annotations

import importlib.util
import logging
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.frames.video.described import Described
from gcs_mosaic.frames.video.names import clock_of, frame_name, video_and_ms
from gcs_mosaic.frames.video.process import describe_videos, read_video
from gcs_mosaic.messages import Frame, Notice, Position, RecordedPosition, content_hash
from gcs_mosaic.processes.child import ChildProcess, ending
from gcs_mosaic.processes.pipe import Message, messages

logger = logging.getLogger(__name__)

Item: TypeAlias = Frame | Notice
Known: TypeAlias = Mapping[str, str]
"""Content hashes of the frames of one video that are in the flight already, by their names."""

NEEDED = "videos need PyAV, which is not installed: pip install 'gcs-mosaic[video]' brings it"
WHAT = "the process that reads a video"
MOST_CRASHES = 2  # of the process without a frame in between
SHORT_SHARE, SHORT_S = 0.9, 2.0  # a video that ends before is cut off: sound often goes on a little longer
DESCRIBED_WITHIN_S = 60.0


def can_read_videos() -> bool:
    return importlib.util.find_spec("av") is not None


class VideoReading:
    """One video, from the beginning or where the `known` frames end. `at_s`, `described`: how far it has come, and of what.

    `refused`: a sentence, once it is known that it is no video.
    """

    def __init__(self, look: Look, settings: StreamSettings, max_pixels: int, known: Known) -> None:
        self.look, self.at_s, self.is_over, self.refused = look, 0.0, False, ""
        self.described: Described | None = None
        self._settings, self._max_pixels = settings, max_pixels
        self._version = max([1, *(_version(name, look.name) for name in known)])
        self._known = {name: digest for name, digest in known.items() if _version(name, look.name) == self._version}
        self._is_told = False
        self._is_same = False  # whether what it brings agrees with the known frames
        self._process: ChildProcess | None = None
        self._utc: float | None = None  # of its beginning, as its metadata tell
        self._last_ms, self._taken, self._crashes = -1, 0, 0

    @property
    def known(self) -> dict[str, str]:
        """The frames that have been taken, with those of earlier runs."""
        return dict(self._known)

    def items(self, wait_s: float) -> Iterator[Item]:
        """What comes within the time; with 0 what is there."""
        if self.is_over:
            return
        try:
            if self._process is None:
                self._begin()
            if self._process is not None:
                for message, mass in messages(self._process.pipe, wait_s):
                    yield from self._items_of(message, mass)
                    if self._process is None:
                        return
        except (EOFError, OSError):
            logger.info("the process that reads %s has ended", self.look.name, exc_info=True)
            yield from self._crashed()

    def close(self) -> str:
        """End the process; returns how it ended."""
        process, self._process = self._process, None
        return "" if process is None else ending(process.end())

    def _begin(self) -> None:
        # The last one may have been chosen at what was the end of a file that has grown since, among fewer pictures.
        before = sorted(self._known)[-2:]
        go_on = None
        if len(before) == 2 and (found := video_and_ms(before[0])):
            go_on = (found[1], self._known[before[0]])
        self._last_ms = -1
        given = str(self.look.path), self._settings, self._max_pixels, go_on
        self._process = ChildProcess(WHAT, read_video, *given)

    def _items_of(self, message: Message, mass: bytes) -> Iterator[Item]:
        """What a message of the process tells. Raises OSError for one that is none of it."""
        try:
            if "described" in message:
                yield from self._begun(Described(**message["described"]))
            elif "reached" in message:
                self.at_s = float(message["reached"]["seconds"])
            elif "frame" in message:
                yield from self._frame(message["frame"], mass)
            elif "end" in message:
                yield from self._ended(message["end"])
            elif "refused" in message:
                self.refused = str(message["refused"])
                self._finish()
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise OSError("no message of ours") from error

    def _begun(self, described: Described) -> Iterator[Notice]:
        if not self._is_told:
            self._is_told = True
            length = "" if described.duration_s is None else f", {clock_of(described.duration_s)}"
            yield self._notice("info", f"a video ({described.words}{length}) is read")
        self.described = described

    def _frame(self, told: Mapping[str, Any], data: bytes) -> Iterator[Frame]:
        ms, digest = int(told["ms"]), content_hash(data)
        if ms <= self._last_ms:
            raise ValueError("frames come in order")
        self._last_ms, self._crashes = ms, 0
        self._utc = _number(told["utc"]) if self._utc is None else self._utc
        name = frame_name(self.look.name, self._version, ms)
        if self._known and not self._is_same:
            self._compare(name, digest)
            name = frame_name(self.look.name, self._version, ms)
        if name in self._known:
            return
        self._known[name] = digest
        self._is_same = True
        self._taken += 1
        yield Frame(
            name=name,
            path=self.look.path / Path(name).name,  # nothing can be there
            data=data,
            content_hash=digest,
            size=len(data),
            received=time.monotonic(),
            modified=self._begin_utc() + ms / 1000,
            recorded=self._recorded(told, ms / 1000),
        )

    def _compare(self, name: str, digest: str) -> None:
        """Another recording has taken this one's name, or it is the same."""
        self._is_same = True
        if self._known.get(name) != digest:
            self._version, self._known = self._version + 1, {}

    def _recorded(self, told: Mapping[str, Any], seconds: float) -> RecordedPosition | None:
        if told["position"] is None:
            return None
        utc = self._told_utc()
        by = f"{told['told_by'] if utc is None else 'KLV' if told['told_by'] == 'KLV' else 'SRT'}"[:200]
        return RecordedPosition(position=Position(**told["position"]), time_s=(utc or 0.0) + seconds, told_by=by)

    def _told_utc(self) -> float | None:
        """When it began, by what it says itself."""
        return self._utc if self._utc is not None or self.described is None else self.described.utc

    def _begin_utc(self) -> float:
        """... or else by the file's time, at which it usually ended."""
        utc, length = self._told_utc(), self.described.duration_s if self.described else None
        return self.look.modified_ns / 1e9 - (length or 0.0) if utc is None else utc

    def _ended(self, told: Mapping[str, Any]) -> Iterator[Notice]:
        self._finish()
        self.at_s = float(told["seconds"])
        if not int(told["pictures"]):
            self.refused = str(told["stopped"]) or NO_PICTURE
            return
        if told["stopped"]:
            yield self._notice("warning", f"is read up to {clock_of(self.at_s)}: {told['stopped']}")
        elif self._is_cut_off():
            length = clock_of(self.described.duration_s or 0.0) if self.described else ""
            yield self._notice(
                "warning", f"ends at {clock_of(self.at_s)} of {length}: copy it again, the rest is missing"
            )
        if damaged := int(told["damaged"]):
            yield self._notice(
                "warning", f"{damaged} of {told['pictures']} pictures are damaged; none of them is taken"
            )
        yield self._notice("info", f"{clock_of(self.at_s)} are read, {self._taken} frames are taken of it")

    def _is_cut_off(self) -> bool:
        length = self.described.duration_s if self.described else None
        return length is not None and self.at_s < SHORT_SHARE * length - SHORT_S

    def _crashed(self) -> Iterator[Notice]:
        how = self.close()
        self._crashes += 1
        if self._crashes < MOST_CRASHES:
            return  # it is begun again where it was
        self.is_over = True
        text = f"cannot be read beyond {clock_of(self.at_s)} ({how}): what came before is taken"
        if not self._taken and not self._known:
            self.refused = f"it cannot be decoded ({how}): convert it to H.264 in an MP4"
        else:
            yield self._notice("warning", text)

    def _finish(self) -> None:
        self.close()
        self.is_over = True

    def _notice(self, level: Literal["info", "warning"], text: str) -> Notice:
        return Notice(source="video", level=level, text=f"{versioned(self.look.name, self._version)}: {text}")


NO_PICTURE = "no picture in it can be decoded: see whether the file was copied as a whole"


def _version(name: str, video: str) -> int:
    found = video_and_ms(name)
    number = "" if found is None else found[0].removeprefix(video).removeprefix("#")
    return int(number) if number.isdecimal() else 1


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def known_by_video(frames: Iterable[tuple[str, str]]) -> dict[str, dict[str, str]]:
    """Frames of videos, each with its content hash, by the video's name without its version."""
    known: dict[str, dict[str, str]] = {}
    for name, digest in frames:
        if found := video_and_ms(name):
            known.setdefault(found[0].partition("#")[0] if _is_versioned(found[0]) else found[0], {})[name] = digest
    return known


def _is_versioned(video: str) -> bool:
    return video.rpartition("#")[2].isdecimal()


def describe(paths: Sequence[Path], max_pixels: int) -> list[Described | str]:
    """What each video is; a sentence for each that is none. One that ends the process costs the others nothing."""
    told: list[Described | str] = []
    while len(told) < len(paths):
        rest = [str(path) for path in paths[len(told) :]]
        process, before = ChildProcess(WHAT, describe_videos, rest, max_pixels), len(told)
        try:
            while len(told) < len(paths) and process.pipe.poll(DESCRIBED_WITHIN_S):
                message, _ = next(messages(process.pipe, 0.0))
                told.append(_described(message))
        except (EOFError, OSError, StopIteration):
            logger.info("the process that looks at videos has ended", exc_info=True)
        how = ending(process.end())
        if len(told) == before:
            told.append(f"it cannot be decoded ({how}): convert it to H.264 in an MP4")
    return told


def _described(message: Message) -> Described | str:
    try:
        return Described(**message["described"]) if "described" in message else str(message["refused"])
    except (KeyError, TypeError) as error:
        raise OSError("no message of ours") from error


def read_all(readings: Iterable[VideoReading]) -> Iterator[Item]:
    """One video after another, to its end."""
    for reading in readings:
        try:
            while not reading.is_over:
                yield from reading.items(1.0)
        finally:
            reading.close()
        if reading.refused:
            yield Notice(source="video", level="warning", text=f"{reading.look.name} is passed over: {reading.refused}")
