"""Videos among files and folders named on the command line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import looks_in, name_order
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.scan import Look, scan
from gcs_mosaic.frames.video.described import Described
from gcs_mosaic.frames.video.names import is_video
from gcs_mosaic.frames.video.reading import NEEDED, Known, VideoReading, can_read_videos, describe


@dataclass(frozen=True, slots=True)
class GivenVideos:
    """Videos in the order in which they are read; `passed_over`: sentences about files that are none."""

    readings: tuple[VideoReading, ...] = ()
    order: str = ""
    passed_over: tuple[str, ...] = ()

    @property
    def seconds(self) -> float | None:
        """Their length together; None if one does not tell its own."""
        lengths = [one.described.duration_s if one.described else None for one in self.readings]
        known = [length for length in lengths if length is not None]
        return sum(known) if len(known) == len(lengths) else None

    @property
    def seconds_read(self) -> float:
        """How much of it has been read."""
        return sum(one.at_s for one in self.readings)


def apart(paths: Sequence[Path]) -> tuple[list[Path], list[Look]]:
    """Images and folders with images; and the videos, also those in folders. Raises UsageError for a file that is not there."""
    images, videos = list[Path](), list[Look]()
    for path in paths:
        if path.is_dir():
            found = scan(path)
            videos += sorted(found.videos, key=lambda look: name_order(look.name))
            if found.images or not found.videos:
                images.append(path)
        elif is_video(path):
            videos += looks_in(path, videos_too=True)[0]
        else:
            images.append(path)
    return images, _told_apart(videos)


def videos_of(
    looks: Sequence[Look],
    settings: StreamSettings,
    max_pixels: int,
    known: Mapping[str, Known],
    *,
    as_given: bool,
) -> GivenVideos:
    """What is to be read of these files; `known`: frames that the flight has already, by video. `as_given`: in this order.

    Raises UsageError if PyAV is missing.
    """
    if not looks:
        return GivenVideos()
    if not can_read_videos():
        raise UsageError(f"{NEEDED}.")
    told = list(zip(looks, describe([look.path for look in looks], max_pixels), strict=True))
    passed_over = tuple(f"{look.name} is passed over: {what}" for look, what in told if isinstance(what, str))
    films = [(look, what) for look, what in told if isinstance(what, Described)]
    order = "in the order given"
    if not as_given:
        films, order = _in_order(films)
    readings = []
    for look, described in films:
        readings.append(VideoReading(look, settings, max_pixels, known.get(look.name, {})))
        readings[-1].described = described
    count = "1 video" if len(readings) == 1 else f"{len(readings)} videos {order}"
    return GivenVideos(tuple(readings), count, passed_over)


def _in_order(films: list[tuple[Look, Described]]) -> tuple[list[tuple[Look, Described]], str]:
    """By when they began, if all tell; parts of one recording may all tell its beginning, and are in the order of their names."""
    if any(described.utc is None for _, described in films):
        return films, "in the order of their names"
    return sorted(films, key=lambda one: one[1].utc or 0.0), "in the order of their times"


def _told_apart(looks: list[Look]) -> list[Look]:
    """Of several files with one name all but the first get a number before it."""
    seen = Counter[str]()
    for at, look in enumerate(looks):
        seen[look.name] += 1
        if seen[look.name] > 1:
            looks[at] = replace(look, name=f"{seen[look.name]}/{look.name}")
    return looks
