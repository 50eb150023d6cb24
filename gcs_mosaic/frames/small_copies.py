"""Small copies of frames under the same name in another folder, whatever that is called. Pure but for EXIF times."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from gcs_mosaic.frames.exif import capture_time

SMALLER = 0.9  # of width and height, at most
SAME_ASPECT = 0.02  # relative
TOGETHER_S = 60.0  # between the times of files that tell no capture time
MOST = 20_000  # names kept


@dataclass(frozen=True, slots=True)
class SizedFile:
    """A file with its picture's size in px and its time in seconds since 1970."""

    name: str  # POSIX, with its folders
    path: Path
    size: tuple[int, int]
    modified: float

    def is_copy_of(self, other: SizedFile) -> bool:
        """Whether this is a smaller picture of the other, of the same moment, in another folder."""
        if PurePosixPath(self.name).parent == PurePosixPath(other.name).parent:
            return False
        across, down = self.size[0] / other.size[0], self.size[1] / other.size[1]
        if max(across, down) > SMALLER or abs(across / down - 1) > SAME_ASPECT:
            return False
        own, others = capture_time(self.path), capture_time(other.path)
        if own is not None and others is not None:
            return own == others  # the counters of two cards begin with the same names
        return abs(self.modified - other.modified) <= TOGETHER_S


class SmallCopies:
    """Of one folder and those below."""

    def __init__(self) -> None:
        self._largest: OrderedDict[str, SizedFile] = OrderedDict()  # by the last part of the name

    def is_one(self, file: SizedFile) -> bool:
        """Whether a file that has come is a small copy of one that came before."""
        name = PurePosixPath(file.name).name.casefold()
        before = self._largest.setdefault(name, file)
        if file.is_copy_of(before):
            return True
        if file.size[0] * file.size[1] > before.size[0] * before.size[1]:
            self._largest[name] = file
        if len(self._largest) > MOST:
            self._largest.popitem(last=False)
        return False
