"""Frames of a recorded video, chosen by the same code as those of a live stream; time is that of the video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from gcs_mosaic.frames.rtsp.clock import CaptureClock
from gcs_mosaic.frames.rtsp.conversion import Converter
from gcs_mosaic.frames.rtsp.frame_selection import Ask, Pick, Picker
from gcs_mosaic.frames.rtsp.interval import Wishes
from gcs_mosaic.frames.rtsp.ring_buffer import Ring, StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.video.described import ENCRYPTED, Described
from gcs_mosaic.frames.video.film import Film, FilmPicture
from gcs_mosaic.frames.video.srt import read_subtitles, subtitles_beside
from gcs_mosaic.frames.video.track import Track
from gcs_mosaic.frames.video.upright import Orientation, square_pixels
from gcs_mosaic.messages import Position, content_hash

EVERY = "overlap"  # a recorded flight has no triggers
RING_MB = 160
MOST_FRAMES = 100_000  # of one video
SEEK_BEFORE_S = (2.0, 15.0, 60.0)  # the decoder begins at a key frame, and these are up to that far apart


@dataclass(frozen=True, slots=True)
class ChosenPicture:
    """A frame: `ms` from the beginning, its JPEG, and what the recording tells of its place; `utc` of the beginning where
    metadata within it tell that (seconds since 1970)."""

    ms: int
    jpeg: bytes
    position: Position | None
    told_by: str
    utc: float | None = None


@dataclass(frozen=True, slots=True)
class Reached:
    """How far it has been read: seconds from the beginning."""

    seconds: float


@dataclass(frozen=True, slots=True)
class ReadToTheEnd:
    """The last of it. `stopped`: why the rest is left out."""

    seconds: float
    pictures: int
    damaged: int
    taken: int
    stopped: str = ""


@dataclass(frozen=True, slots=True)
class GoOn:
    """The frame from which an earlier run is gone on with: when it was taken, and what it was."""

    ms: int
    content_hash: str


Told: TypeAlias = Described | ChosenPicture | Reached | ReadToTheEnd


class _FilmClock(CaptureClock):
    """Times within the video are moments."""

    def __init__(self) -> None:
        super().__init__(0.0, 0.0)

    def moment(self, picture_s: float) -> float:
        return picture_s

    def is_settled(self, now: float) -> bool:
        return True


_CLOCK = _FilmClock()


def extract(path: Path, settings: StreamSettings, max_pixels: int, go_on: GoOn | None = None) -> Iterator[Told | str]:
    """What is in a video; a sentence instead if it is none.

    `go_on`: begin at that frame, if it is found again as it was; else from the beginning.
    """
    track = _subtitles(path)
    for before_s in SEEK_BEFORE_S if go_on is not None else ():
        found = _gone_on(path, settings, max_pixels, track, go_on, before_s)
        if found is not None:
            yield from found
            return
    film = Film.open(path, max_pixels)
    if isinstance(film, str):
        yield film
        return
    yield film.described
    yield from _Extraction(film, settings, track).told()


def _gone_on(
    path: Path, settings: StreamSettings, max_pixels: int, track: Track, go_on: GoOn | None, before_s: float
) -> Iterator[Told] | None:
    """The rest of a video from a frame of an earlier run on; None if that is not found from so far before it."""
    film = Film.open(path, max_pixels)
    if isinstance(film, str) or go_on is None:
        return None
    begun = _Extraction(film, settings, track, go_on) if film.seek(max(go_on.ms / 1000 - before_s, 0.0)) else None
    first = None if begun is None else next((one for one in begun.told() if isinstance(one, ChosenPicture)), None)
    film.close()
    if first is None or first.ms != go_on.ms or content_hash(first.jpeg) != go_on.content_hash:
        return None
    film = Film.open(path, max_pixels)
    if isinstance(film, str) or not film.seek(max(go_on.ms / 1000 - before_s, 0.0)):
        return None
    return _with_head(film, _Extraction(film, settings, track, go_on))


def _with_head(film: Film, extraction: _Extraction) -> Iterator[Told]:
    yield film.described
    yield from extraction.told()


def _subtitles(path: Path) -> Track:
    beside = subtitles_beside(path)
    try:
        return Track() if beside is None else read_subtitles(beside)
    except OSError:
        return Track()


class _Extraction:
    """One way through a film, from the place where it is."""

    def __init__(self, film: Film, settings: StreamSettings, track: Track, go_on: GoOn | None = None) -> None:
        # Farther pictures than these need not be kept: a film waits for nobody.
        self._settings = replace(settings, farthest_s=settings.window_s)
        self._film, self._track, self._go_on = film, track, go_on
        self._is_own_track = not len(track)
        self._wishes = Wishes(settings.every or EVERY, settings.moved)
        self._picker, self._ring = Picker(self._settings), Ring(2.5 * settings.window_s, RING_MB << 20)
        self._converter = Converter()
        self._turned: dict[int, Orientation] = {}
        self._utc: float | None = None
        self._pictures = self._damaged = self._taken = 0

    def told(self) -> Iterator[Told]:
        """Frames, progress, and the end."""
        seconds, stopped = 0.0, ""
        try:
            for picture in self._film.pictures():
                seconds = picture.seconds
                yield from self._take(picture)
                yield Reached(seconds)
                if self._taken >= MOST_FRAMES:
                    stopped = f"{MOST_FRAMES} frames of it are taken, which is the limit"
                    break
        except OSError as error:
            stopped = f"it cannot be read any further ({error.strerror or type(error).__name__})"
        stopped = ENCRYPTED if self._film.is_encrypted else stopped
        yield from self._chosen(seconds + 10 * self._settings.patience_s, self._ring.pictures())
        yield ReadToTheEnd(seconds, self._pictures, self._damaged, self._taken, stopped)
        self._film.close()

    def _take(self, picture: FilmPicture) -> Iterator[ChosenPicture]:
        self._pictures += 1
        self._damaged += picture.damaged
        self._hear()
        taken = StreamPicture(self._converter.picture(picture.video), picture.seconds, _CLOCK, picture.damaged)
        self._turned[id(taken)] = picture.orientation
        # Of a slow camera or a time lapse the picture before is the one that is waited for, and is dropped when the next comes.
        yield from self._chosen(picture.seconds, [*self._ring.pictures(), taken])
        self._ring.put(taken, picture.seconds)
        self._turned = {id(one): self._turned[id(one)] for one in self._ring.pictures()}
        if self._is_wanted(taken):
            self._picker.ask(Ask(picture.seconds), picture.seconds)

    def _is_wanted(self, picture: StreamPicture) -> bool:
        if self._go_on is not None:
            if _ms(picture.time_s) < self._go_on.ms:
                return False
            self._go_on = None
            self._wishes.go_on(picture)
            return True
        return not picture.damaged and self._wishes.moment(picture) is not None

    def _chosen(self, now: float, pictures: Sequence[StreamPicture]) -> Iterator[ChosenPicture]:
        for decided in self._picker.due(pictures, now):
            if isinstance(decided, Pick):
                self._taken += 1
                yield self._encoded(decided)

    def _encoded(self, pick: Pick) -> ChosenPicture:
        turned = self._turned[id(pick.picture)]
        image = turned.applied(square_pixels(pick.picture.colour(), self._film.described.pixel_aspect))
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._settings.jpeg_quality]
        jpeg: bytes = np.asarray(cv2.imencode(".jpg", image, quality)[1]).tobytes()
        return ChosenPicture(_ms(pick.ask.moment), jpeg, self._track.at(pick.moment), self._track.by, self._utc)

    def _hear(self) -> None:
        """Positions within the recording count where there are none beside it."""
        for seconds, report in self._film.reports:
            if report.utc is not None and self._utc is None:
                self._utc = report.utc - seconds
            if self._is_own_track:
                self._track.by = "KLV"
                self._track.add(seconds, report.position)
        self._film.reports.clear()


def _ms(seconds: float) -> int:
    return round(1000 * seconds)
