"""Frames from existing files: files and folders named on the command line."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import groupby
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.cameras import Chosen, ShotBands, chosen_of
from gcs_mosaic.frames.decoding.proof import Proof
from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.integrity import NotWhole
from gcs_mosaic.frames.multiband.shots import BandShots
from gcs_mosaic.frames.passed_over import OTHER_PICTURES, RAW_SUFFIXES, Kinds, PassedOver, in_words, stem_of
from gcs_mosaic.frames.pending_file import FileRead, Prove, frame_of, read_whole, versioned
from gcs_mosaic.frames.scan import LEDGER, VIDEO_SUFFIXES, Look, scan, shown_name
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import DamagedFile, Frame, Notice, OtherFile, content_hash

FRAMES_OF_VIDEOS = "gcs-mosaic stitch takes those, and keeps their frames in DIR/frames, which can be given here."


@dataclass(frozen=True, slots=True)
class Given:
    """A number of files, each yielded as a frame or as a DamagedFile with the reason, read on demand.

    As text for the operator: `order`, how they are sorted; `passed_over`, what could not be inspected. `notes`: further
    remarks for the log. `said`: what has shown since, while frames were read; to be taken out. `of_bands`: names of the frames
    that may be made of several files.
    """

    count: int
    frames: Iterator[Frame | DamagedFile]
    order: str
    passed_over: tuple[str, ...]
    notes: tuple[str, ...]
    said: deque[Notice] = field(default_factory=deque)
    of_bands: frozenset[str] = frozenset()


def frames_in(paths: Path | Iterable[Path], settings: FolderSettings | None = None) -> Given:
    """The frames of files and folders.

    Files come in the order given. Those of folders (and subfolders) are sorted by capture time, if all have one
    and no two are equal; otherwise folder by folder by name, in natural order.
    Raises UsageError immediately for a path that does not exist and for a folder without images.
    """
    settings = settings or FolderSettings()
    together = settings.bands == "together"
    found = files_in([paths] if isinstance(paths, Path) else list(paths), settings.cameras, together=together)
    said = deque[Notice]()
    frames = _frames_of_bands(found, settings, said) if found.bands else _frames(found.looks, settings)
    of_bands = frozenset(look.name for look in found.looks if look.path in found.bands)
    return Given(len(found.looks), frames, found.order, found.passed_over, found.notes, said, of_bands)


@dataclass(frozen=True, slots=True)
class GivenFiles:
    """Files that are not read yet, in order; the rest as in `Given`."""

    looks: list[Look]
    order: str
    passed_over: tuple[str, ...]
    notes: tuple[str, ...]
    bands: Mapping[Path, ShotBands] = field(default_factory=dict)


def files_in(given: list[Path], cameras: Sequence[str] = (), *, together: bool = False) -> GivenFiles:
    """As `frames_in`, without reading the files; `cameras` are patterns as in `FolderSettings`. `together`: as in `chosen_of`."""
    notes, bands = list[str](), dict[Path, ShotBands]()
    looks, passed_over = list[Look](), list[str]()
    for _, paths in groupby(given, key=lambda path: path if path.is_dir() else None):
        found = [looks_in(path) for path in paths]  # files that are named one by one are told apart together
        chosen = _chosen([look for looks, _ in found for look in looks], cameras, together=together)
        looks += chosen.looks
        bands |= chosen.bands
        passed_over += [*(text for _, texts in found for text in texts), *([chosen.said] if chosen.said else [])]
    in_folders = all(path.is_dir() for path in given)
    ordered, order = _in_order(looks, notes.append) if in_folders else (looks, "in the order given")
    count = "1 frame" if len(looks) == 1 else f"{len(looks)} frames"
    return GivenFiles(ordered, f"{count} {order}", tuple(passed_over), tuple(notes), bands)


def _in_order(looks: list[Look], note: Callable[[str], None]) -> tuple[list[Look], str]:
    """Files sorted by name, in capture order instead if known; and which order it is."""
    by_names = "in the order of their names"
    times = [capture_time(look.path, note) for look in looks]
    firsts: dict[datetime, Look] = {}
    for look, time in zip(looks, times, strict=True):
        if time is None:
            return looks, f"{by_names} ({look.name} tells no capture time)" if any(times) else by_names
        if time in firsts:
            return looks, f"{by_names} ({firsts[time].name} and {look.name} have the same capture time)"
        firsts[time] = look
    return [firsts[time] for time in sorted(firsts)], "in the order of their capture times (EXIF)"


def name_order(name: str) -> tuple[tuple[tuple[int, str], ...], str]:
    """Natural sort key: IMG_9 before IMG_10; unique for each name."""
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)), name


def mapped_of(looks: list[Look], cameras: Sequence[str]) -> tuple[list[Look], list[str]]:
    """Those of one camera where several take each shot, and what is to be said of the others.

    Raises UsageError if the patterns leave nothing.
    """
    chosen = _chosen(looks, cameras)
    return chosen.looks, [chosen.said] if chosen.said else []


def _chosen(looks: list[Look], cameras: Sequence[str], *, together: bool = False) -> Chosen:
    chosen = chosen_of(looks, cameras, together=together)
    if looks and not chosen.looks:
        raise UsageError(
            f"cameras: none of {len(looks)} images is called {' or '.join(cameras)}, the first is {looks[0].name}: give "
            "patterns of the names, such as '*_T.*', or none."
        )
    return chosen


def looks_in(path: Path, *, videos_too: bool = False) -> tuple[list[Look], list[str]]:
    """The file, or the files of the folder sorted by name; and what could not be inspected, as text. `videos_too`: a file may be
    a video.

    Raises UsageError as `frames_in` does.
    """
    try:
        if not path.is_dir() and not videos_too and path.suffix.lower() in VIDEO_SUFFIXES and path.is_file():
            raise UsageError(f"{str(path)!r} is a video: {FRAMES_OF_VIDEOS}")
        if not path.is_dir():
            status = path.stat()
            return [Look(path, shown_name(Path(path.name)), status.st_size, status.st_mtime_ns)], []
        next(path.iterdir(), None)  # raises the reason why a folder cannot be read; a scan skips it
    except OSError as error:
        raise UsageError(
            f"{str(path)!r} cannot be read ({error.strerror}): give image files or a folder of them."
        ) from error
    found = scan(path)
    images = sorted(found.images, key=lambda look: name_order(look.name))
    without = PassedOver().kinds(found.others, {stem_of(look.name) for look in images}, lambda name: False)
    if not images:
        if (path / LEDGER).is_file():
            raise UsageError(
                f"{str(path)!r} is a flight, whose tiles are no frames: give {str(path / 'frames')!r}, where its originals are."
            )
        if found.videos:
            raise UsageError(f"{str(path)!r} holds videos and no images: {FRAMES_OF_VIDEOS}")
        there = f" (but {in_words(without)})" if without else ""
        raise UsageError(
            f"{str(path)!r} holds no images{there}: give a folder with JPEG, PNG or TIFF files (links are not followed)."
        )
    return images, [*sorted(found.unreadable), *_left_out(without)]


def _left_out(kinds: Kinds) -> Iterator[str]:
    raw = tuple(one for one in kinds if one[0] in RAW_SUFFIXES)
    if raw:
        yield f"RAW files without a JPEG beside them are left out ({in_words(raw)}): they are not read"
    others = tuple(one for one in kinds if one[0] in OTHER_PICTURES)
    if others:
        yield f"pictures of other kinds are left out ({in_words(others)}): JPEG, PNG and TIFF are read, so convert them first"
    previews = tuple(one for one in kinds if one[0].endswith("/"))
    if previews:
        yield f"folders of small copies are left out ({in_words(previews)}); name one of them to stitch what is in it"


def _frames(looks: list[Look], settings: FolderSettings) -> Iterator[Frame | DamagedFile]:
    seen = Counter[str]()
    for look in looks:
        seen[look.name] += 1
        yield read_frame(look, versioned(look.name, seen[look.name]), settings)


def _frames_of_bands(found: GivenFiles, settings: FolderSettings, said: deque[Notice]) -> Iterator[Frame | DamagedFile]:
    """As `_frames`; the bands of each shot are one frame, where they can be registered."""
    with closing(Proof(None, settings.max_pixels)) as proof:
        shots = BandShots(proof.load, lambda name: None)
        for look, item in zip(found.looks, _frames(found.looks, settings), strict=True):
            bands = found.bands.get(look.path)
            if bands is None or isinstance(item, DamagedFile):
                yield item
                continue
            files = {bands.reference: item} | _others_of(bands, settings)
            yield from _heard(shots.take_whole(files, bands.reference, 0.0), said)
        yield from _heard(shots.all_there(), said)


def _others_of(bands: ShotBands, settings: FolderSettings) -> dict[str, Frame]:
    """The bands beside the reference that can be read."""
    others = {camera: look for camera, look in bands.looks.items() if camera != bands.reference}
    read = {camera: read_frame(look, look.name, settings) for camera, look in others.items()}
    return {camera: replace(one, data=None) for camera, one in read.items() if isinstance(one, Frame)}


def _heard(items: Iterable[Frame | OtherFile | Notice], said: deque[Notice]) -> Iterator[Frame]:
    for item in items:
        if isinstance(item, Notice):
            said.append(item)
        elif isinstance(item, Frame):
            yield item


def read_frame(look: Look, name: str, settings: FolderSettings, prove: Prove | None = None) -> Frame | DamagedFile:
    """The file as a frame of this name, or why it is not one. Whether all of its picture is there is told by `prove`, or else
    seen when it is decoded."""
    found = read_whole(look, settings) if look.path.is_file() else NotWhole("not a regular file")
    if isinstance(found, FileRead):
        digest = content_hash(found.data)
        if found.doubt and prove is not None and (reason := prove(found.data, digest)):
            return DamagedFile(name=name, reason=reason)
        return frame_of(look, name, found.data, digest)
    return DamagedFile(name=name, reason=found.reason if found else "it changed or went while it was read")
