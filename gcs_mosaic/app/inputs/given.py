"""What `gcs-mosaic stitch` is given: images, folders of them, recorded videos; each frame once, also when it is gone on with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import Given, frames_in
from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.frames.video.given import GivenVideos, apart, videos_of
from gcs_mosaic.frames.video.reading import known_by_video, read_all
from gcs_mosaic.messages import DamagedFile, Frame, Notice


@dataclass(frozen=True, slots=True)
class GivenFrames:
    """Images first, then videos. `known`, `times`: content hashes and modification times of the frames that the flight has
    already, by name."""

    images: Given | None
    videos: GivenVideos
    known: Mapping[str, str]
    times: Mapping[str, float | None]

    @property
    def order(self) -> str:
        """For the operator."""
        told = [self.images.order] if self.images else []
        return ", then ".join([*told, self.videos.order] if self.videos.order else told)

    @property
    def passed_over(self) -> tuple[str, ...]:
        return (*(self.images.passed_over if self.images else ()), *self.videos.passed_over)

    @property
    def notes(self) -> tuple[str, ...]:
        return self.images.notes if self.images else ()

    @property
    def steps(self) -> float | None:
        """Of a progress bar: images, and seconds of videos; None if that is not known."""
        seconds = self.videos.seconds
        return None if seconds is None else (self.images.count if self.images else 0) + round(seconds)

    def steps_done(self, frames_done: int) -> float:
        """After so many frames."""
        images = min(frames_done, self.images.count if self.images else 0)
        return images + round(self.videos.seconds_read)

    def items(self) -> Iterator[Frame | DamagedFile | Notice]:
        """Frames that are not known yet, files that are none, and what is to be said; files are read on demand."""
        for item in self.images.frames if self.images else ():
            yield from self._said()
            if (new := self._new(item)) is not None:
                yield new
        yield from self._said()
        yield from read_all(self.videos.readings)

    def _said(self) -> Iterator[Notice]:
        while self.images and self.images.said:
            yield self.images.said.popleft()

    def _new(self, item: Frame | DamagedFile) -> Frame | DamagedFile | None:
        if item.name not in self.known:
            return item
        if isinstance(item, DamagedFile):
            return None
        for version in count(1):
            name = versioned(item.name, version)
            if self.known.get(name) == item.content_hash or self._is_of_known_bands(item, name):
                return None
            if name not in self.known:
                return replace(item, name=name)
        return None

    def _is_of_known_bands(self, frame: Frame, name: str) -> bool:
        """Whether the flight has the shot by this name: alone or registered otherwise, its bands are other bytes."""
        is_of_bands = self.images is not None and frame.name in self.images.of_bands
        return is_of_bands and self.times.get(name) == frame.modified


def given_frames(
    sources: Sequence[Path], config: Config, known: Mapping[str, str], times: Mapping[str, float | None]
) -> GivenFrames:
    """Raises UsageError for what does not exist, for a folder without images, and where no video is one."""
    paths, looks = apart(sources)
    images = frames_in(paths, config.frames) if paths else None
    by_video = known_by_video(known.items())
    as_given = not any(path.is_dir() for path in sources)
    videos = videos_of(looks, config.stream, config.frames.max_pixels, by_video, as_given=as_given)
    if images is None and not videos.readings:
        more = f" (and {len(looks) - 1} more)" if len(looks) > 1 else ""
        raise UsageError(f"{videos.passed_over[0].replace(' is passed over', '', 1)}{more}.")
    return GivenFrames(images, videos, known, times)
