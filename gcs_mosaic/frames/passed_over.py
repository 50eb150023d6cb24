"""What lies in a watched folder and is not taken, counted by kind: files of other kinds, folders of previews, files too old.

Pure; the looks are passed in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Set
from pathlib import PurePosixPath
from typing import TypeAlias

# Folders that viewers, storage boxes and cameras (Sony's THMBNL) fill with small copies, or systems with what was there before;
# matched without regard to case. Hidden ones are skipped anyway.
PREVIEW_FOLDERS = frozenset(
    {"@eadir", "@recycle", "#recycle", "$recycle.bin", "__macosx", "thumb", "thumbs", "thumbnail", "thumbnails"}
    | {"preview", "previews", "proxy", "proxies", "lrv", "thm", "thmbnl", "screennail", "screennails"}
    | {"recycler", "recycled", "#snapshot", "~snapshot"}
)
RAW_SUFFIXES = frozenset(
    {
        ".3fr",
        ".arw",
        ".cap",
        ".cr2",
        ".cr3",
        ".crw",
        ".dcr",
        ".dng",
        ".erf",
        ".fff",
        ".gpr",
        ".iiq",
        ".kdc",
        ".mef",
        ".mos",
    }
    | {".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"}
)
OTHER_PICTURES = frozenset({".avif", ".bmp", ".gif", ".heic", ".heif", ".hif", ".jp2", ".jxl", ".pgm", ".ppm", ".webp"})
Kinds: TypeAlias = tuple[tuple[str, int], ...]
"""Endings (or folders of previews, with a slash) and how many files of each there are, most first."""


def is_preview_folder(name: str) -> bool:
    """Whether a folder of this name holds small copies."""
    return name.casefold() in PREVIEW_FOLDERS


class PassedOver:
    """Files that are not taken, and came since the watch began; those of old times that were there before say nothing."""

    def __init__(self) -> None:
        self._before: frozenset[str] | None = None

    def kinds(self, others: Set[str], taken_stems: Set[str], is_old: Callable[[str], bool]) -> Kinds:
        """Each suffix (or, for folders of previews, the folder's name with a slash) and how many files of it came.

        `others`: names (POSIX, relative) of the files that are not taken; those of one look. `taken_stems`: names of the images
        without their endings; a RAW file beside an image of its stem is that image's. `is_old` is asked at the first look.
        """
        if self._before is None:
            self._before = frozenset(name for name in others if is_old(name))
        counts = Counter(
            kind_of(name)
            for name in others - self._before
            if PurePosixPath(name).suffix.lower() not in RAW_SUFFIXES or stem_of(name) not in taken_stems
        )
        return tuple(sorted(counts.items(), key=lambda one: (-one[1], one[0])))


def stem_of(name: str) -> str:
    """A file's name without folder and ending, to compare it with others of one shot."""
    return PurePosixPath(name).stem.casefold()


def kind_of(name: str) -> str:
    """The file's ending, or the first folder of previews that it is in, with a slash."""
    path = PurePosixPath(name)
    folder = next((part for part in path.parts[:-1] if is_preview_folder(part)), None)
    return path.suffix.lower() if folder is None else f"{folder}/"


def in_words(kinds: Kinds) -> str:
    """Such as "6 ending in .ARW, 2 in thumbs/", the first few."""
    told = [f"{count} in {kind}" if kind.endswith("/") else f"{count} {_ending(kind)}" for kind, count in kinds[:4]]
    return ", ".join([*told, "..."] if len(kinds) > len(told) else told)


def _ending(suffix: str) -> str:
    return f"ending in {suffix.upper()}" if suffix else "without an ending"
