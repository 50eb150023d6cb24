"""Two cameras whose files have nothing in common, neither shots nor a counter: told by names of two kinds and pictures of two
sizes that come in turn. Only said: which of them is to be mapped is the operator's choice."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC

from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.picture_size import picture_size
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.messages import CameraCount

PictureSize = tuple[int, int]

LEAST = 3  # files of each
TURNS = 5  # from one to the other: a card that is changed, or a folder that is copied in, is one
_MOST_KINDS = 32  # of names without their digits; more are hashes, which tell nothing


@dataclass(slots=True)
class UnlikeFiles:
    """Of one folder. Pure."""

    _sizes: dict[str, Counter[PictureSize]] = field(default_factory=dict)  # by kind of name
    _turns: Counter[frozenset[str]] = field(default_factory=Counter)
    _last: str = ""

    def note(self, name: str, size: PictureSize) -> None:
        """A picture of this size (width, height) has come under this name (POSIX, with its folders)."""
        kind = _kind(name)
        if kind not in self._sizes and len(self._sizes) >= _MOST_KINDS:
            return
        self._sizes.setdefault(kind, Counter())[size] += 1
        if self._last and kind != self._last:
            self._turns[frozenset((kind, self._last))] += 1
        self._last = kind

    def counts(self) -> tuple[CameraCount, ...]:
        """Both cameras, by the usual sizes of their pictures, the larger first, as mapped; empty if there is one."""
        for pair in (pair for pair, turns in self._turns.items() if turns >= TURNS):
            each = [self._sizes[kind] for kind in pair]
            lying = [{(max(size), min(size)) for size in sizes} for sizes in each]  # upright it is of the same camera
            is_steady = all(len(one) == 1 for one in lying)  # one that is set otherwise, or zooms, has several
            if is_steady and lying[0] != lying[1] and min(sizes.total() for sizes in each) >= LEAST:
                return tuple(_count(sizes) for sizes in sorted(each, key=_usual, reverse=True))
        return ()


def unlike_in(looks: Sequence[Look]) -> tuple[CameraCount, ...]:
    """The same of files that are all there, in the order of their capture times (EXIF), or of the files' own. They
    are opened only where their names are of several kinds."""
    if not 1 < len({_kind(look.name) for look in looks}) <= _MOST_KINDS:
        return ()
    captured = [capture_time(look.path) for look in looks]
    moments = [when.replace(tzinfo=UTC).timestamp() for when in captured if when is not None]
    if len(moments) < len(looks):
        moments = [look.modified_ns / 1e9 for look in looks]
    unlike = UnlikeFiles()
    for _, look in sorted(zip(moments, looks, strict=True), key=lambda one: one[0]):
        if (size := picture_size(look.path)) is not None:
            unlike.note(look.name, size)
    return unlike.counts()


def _kind(name: str) -> str:
    return re.sub(r"\d+", "#", name.casefold())


def _usual(sizes: Counter[PictureSize]) -> PictureSize:
    return sizes.most_common(1)[0][0]


def _count(sizes: Counter[PictureSize]) -> CameraCount:
    width, height = _usual(sizes)
    return CameraCount(f"{width}x{height}", sizes.total(), mapped=True)
