"""The archive's files: in folders that all workers see, or in buckets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from gcs_mosaic.archive.files import files_at, is_bucket
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import files_in, name_order
from gcs_mosaic.frames.scan import IMAGE_SUFFIXES


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file that may be a frame. `bucket`: where `path` is from; empty for a file of the file system."""

    name: str
    bucket: str
    path: str
    size: int
    modified_ns: int

    @property
    def folder(self) -> tuple[str, str]:
        """Where it lies: the bucket, and the path in it."""
        return self.bucket, str(PurePath(self.path).parent)

    def read(self) -> bytes:
        """Its bytes now. Raises OSError, and CannotWrite for a bucket."""
        if not self.bucket:
            return Path(self.path).read_bytes()
        data = files_at(self.bucket).read(self.path)
        if data is None:
            raise FileNotFoundError(2, "it is gone", self.path)
        return data


@dataclass(frozen=True, slots=True)
class Sources:
    """All files in the order in which they are stitched, and what is to be said of them."""

    files: tuple[SourceFile, ...]
    said: tuple[str, ...]


def sources_of(given: Sequence[str]) -> Sources:
    """The files of folders, single files and buckets. Raises UsageError, and CannotWrite for a bucket."""
    folders = [Path(place) for place in given if not is_bucket(place)]
    files, said = list[SourceFile](), list[str]()
    if folders:
        found = files_in(folders)
        files += [
            SourceFile(look.name, "", str(look.path.resolve()), look.size, look.modified_ns) for look in found.looks
        ]
        said += [found.order, *found.passed_over]
    for place in given:
        if is_bucket(place):
            some = _in_bucket(place)
            files += some
            said.append(f"{len(some)} frames of {place} in the order of their names")
    return Sources(_told_apart(files), tuple(said))


def _in_bucket(place: str) -> list[SourceFile]:
    store = files_at(place)
    names = sorted((name for name in store.names("") if Path(name).suffix.lower() in IMAGE_SUFFIXES), key=name_order)
    if not names:
        raise UsageError(f"{place} holds no images: give a bucket, or a part of one, with JPEG, PNG or TIFF files")
    return [SourceFile(name, place, name, store.size(name) or 0, 0) for name in names]


def _told_apart(files: Sequence[SourceFile]) -> tuple[SourceFile, ...]:
    """Files of one name get numbers, as in a flight."""
    seen: dict[str, int] = {}
    found = []
    for file in files:
        count = seen[file.name] = seen.get(file.name, 0) + 1
        name = file.name if count == 1 else f"{file.name}#{count}"
        found.append(SourceFile(name, file.bucket, file.path, file.size, file.modified_ns))
    return tuple(found)
