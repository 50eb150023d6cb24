"""Stage 1: which files are whole frames, and what each is by its content."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Made, Parts, Passing, StageTask, Unmade, task
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import content_hash

TOGETHER = 32  # files read by one task


@dataclass(frozen=True, slots=True)
class ArchiveFrame:
    """A whole picture of the archive, the first with this content; `order`: how many came before it; `size`: width and height by
    its header."""

    order: int
    name: str
    content_hash: str
    file: SourceFile
    size: tuple[int, int]


@dataclass(frozen=True, slots=True)
class ArchiveFiles:
    """The frames in order; and every file with its content's hash, or why it is no frame (then the hash is empty)."""

    frames: tuple[ArchiveFrame, ...]
    files: tuple[tuple[SourceFile, str, str], ...]


def arrivals_of(engine: Engine, files: Sequence[SourceFile], settings: FolderSettings) -> ArchiveFiles:
    """What came."""

    def of(some: tuple[SourceFile, ...]) -> StageTask:
        return task(arrivals, some, settings.max_pixels)

    fit = [file for file in files if file.size <= settings.max_file_bytes]
    found = dict(zip(fit, grouped(engine, "arrivals", fit, of, TOGETHER), strict=True))
    frames: dict[str, ArchiveFrame] = {}
    told = [_told(found.get(file), file, settings) for file in files]
    for file, (digest, _, size) in zip(files, told, strict=True):
        if digest and digest not in frames:
            frames[digest] = ArchiveFrame(len(frames), file.name, digest, file, size)
    return ArchiveFiles(tuple(frames.values()), tuple((file, *one[:2]) for file, one in zip(files, told, strict=True)))


def _told(found: Any, file: SourceFile, settings: FolderSettings) -> tuple[str, str, tuple[int, int]]:
    if found is None:  # not read at all
        return "", f"{file.size} bytes, more than the limit of {settings.max_file_bytes}", (0, 0)
    told: tuple[str, str, tuple[int, int]] = ("", found.reason, (0, 0)) if isinstance(found, Unmade) else found
    return told


def arrivals(artefacts: Artefacts, files: tuple[SourceFile, ...], max_pixels: int) -> Parts:
    """Of each file its content's hash, or why it is no frame; and its picture's size. Raises Passing: one that cannot be read is
    told by itself."""
    return {"summary": [_of(file, max_pixels) for file in files]}


def _of(file: SourceFile, max_pixels: int) -> tuple[str, str, tuple[int, int]]:
    data = bytes_of_file(file)
    if len(data) != file.size:
        raise Passing("it has changed since it was listed")
    whole = is_whole(data, max_pixels)
    if isinstance(whole, NotWhole):
        return "", whole.reason, (0, 0)
    return content_hash(data), "", (whole.width, whole.height)


def bytes_of_file(file: SourceFile) -> bytes:
    """Its bytes now. Raises Passing."""
    try:
        return file.read()
    except OSError as error:
        raise Passing(f"cannot be read ({error.strerror})") from None


T = TypeVar("T")


def grouped(
    engine: Engine, stage: str, items: Sequence[T], of: Callable[[tuple[T, ...]], StageTask], size: int
) -> list[Any]:
    """What the summaries of tasks `of` groups of items hold for each item, or Unmade. Raises FlightFailed as `Engine.run`."""
    groups = [tuple(items[at : at + size]) for at in range(0, len(items), size)]
    found: list[Any] = []
    for group, outcome in zip(groups, engine.run(stage, [of(group) for group in groups]), strict=True):
        if isinstance(outcome, Made):
            found += outcome.summary
            continue
        for one in engine.run(f"{stage}, one by one", [of((item,)) for item in group]):
            found += one.summary if isinstance(one, Made) else [Unmade(one.reason)]
    return found
