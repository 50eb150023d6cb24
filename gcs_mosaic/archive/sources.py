"""The archive's files: in folders that all workers see, or in buckets."""

from __future__ import annotations

import errno
import stat
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath, PurePosixPath

from gcs_mosaic.archive.files import files_at, is_bucket
from gcs_mosaic.archive.target import MARKER
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import files_in, mapped_of, name_order
from gcs_mosaic.frames.passed_over import is_preview_folder
from gcs_mosaic.frames.scan import IMAGE_SUFFIXES, OURS, Look
from gcs_mosaic.store.status import frames_words


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file that may be a frame. `bucket`: where `path` is from; empty for a file of the file system. `tag`: changes with what
    an object of a bucket holds."""

    name: str
    bucket: str
    path: str
    size: int
    modified_ns: int
    tag: str = ""

    @property
    def folder(self) -> tuple[str, str]:
        """Where it lies: the bucket, and the path in it."""
        return self.bucket, str(PurePath(self.path).parent)

    def read(self) -> bytes:
        """Its bytes now. Raises OSError, and CannotWrite for a bucket."""
        if not self.bucket:
            path = Path(self.path)
            if not stat.S_ISREG(path.stat().st_mode):  # a pipe or a device may have no end, or block for ever
                raise OSError(errno.EINVAL, "not a regular file", self.path)
            return path.read_bytes()
        data = files_at(self.bucket).read(self.path)
        if data is None:
            raise FileNotFoundError(2, "it is gone", self.path)
        return data


@dataclass(frozen=True, slots=True)
class Sources:
    """All files in the order in which they are stitched, and what is to be said of them."""

    files: tuple[SourceFile, ...]
    said: tuple[str, ...]


def sources_of(given: Sequence[str], cameras: Sequence[str] = ()) -> Sources:
    """The files of folders, single files and buckets; `cameras` are patterns as in `FolderSettings`.

    Raises UsageError, and CannotWrite for a bucket.
    """
    folders = [Path(place) for place in given if not is_bucket(place)]
    files, said = list[SourceFile](), list[str]()
    if folders:
        found = files_in(folders, cameras)
        files += [
            SourceFile(look.name, "", str(look.path.resolve()), look.size, look.modified_ns) for look in found.looks
        ]
        said += [found.order, *found.passed_over]
    for place in given:
        if is_bucket(place):
            some, left_out = _mapped_of(_in_bucket(place), cameras)
            files += some
            said += [f"{frames_words(len(some))} of {place} in the order of their names", *left_out]
    return Sources(_told_apart(files), tuple(said))


def _in_bucket(place: str) -> list[SourceFile]:
    listed = {PurePosixPath(one.name): one for one in files_at(place).listed("")}
    ours = {path.parent for path in listed if path.name in OURS} | {
        path.parents[1] for path in listed if path.parts[-2:] == PurePosixPath(MARKER).parts
    }
    found = [one for path, one in listed.items() if _may_be_a_frame(path) and ours.isdisjoint(path.parents)]
    if not found:
        raise UsageError(f"{place} holds no images: give a bucket, or a part of one, with JPEG, PNG or TIFF files")
    found.sort(key=lambda one: name_order(one.name))
    return [SourceFile(one.name, place, one.name, one.size, one.modified_ns, one.tag) for one in found]


def _mapped_of(files: Sequence[SourceFile], cameras: Sequence[str]) -> tuple[list[SourceFile], list[str]]:
    """As in a folder: of one camera, where several take each shot."""
    looks, said = mapped_of([Look(Path(one.path), one.name, one.size, one.modified_ns) for one in files], cameras)
    names = {look.name for look in looks}
    return [one for one in files if one.name in names], said


def _may_be_a_frame(path: PurePosixPath) -> bool:
    """By its name, as in a folder."""
    passed_over = any(part.startswith(".") or is_preview_folder(part) for part in path.parts[:-1])
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and not passed_over


def _told_apart(files: Sequence[SourceFile]) -> tuple[SourceFile, ...]:
    """Files of one name get numbers, as in a flight."""
    seen: dict[str, int] = {}
    found = []
    for file in files:
        count = seen[file.name] = seen.get(file.name, 0) + 1
        name = file.name if count == 1 else f"{file.name}#{count}"
        found.append(replace(file, name=name))
    return tuple(found)
