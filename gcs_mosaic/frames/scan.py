"""One look at a folder and all below it."""

from __future__ import annotations

import logging
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

logger = logging.getLogger(__name__)

IMAGE_SUFFIXES = {".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff"}
_UNFINISHED = {".part", ".tmp", ".partial", ".crdownload"}
_LEDGER = "flight.sqlite"  # a folder that holds it is a flight of ours: its pictures are not new ones


@dataclass(frozen=True, slots=True)
class Look:
    """A file as it was at one moment. `name` is its POSIX path below the folder, made printable."""

    path: Path
    name: str
    size: int
    modified_ns: int

    @property
    def signature(self) -> tuple[int, int]:
        """Changes when the file does."""
        return self.size, self.modified_ns


@dataclass(slots=True)
class Scan:
    """What one look found: images by name and suffix only, and what was passed over."""

    images: list[Look] = field(default_factory=list)
    strangers: set[str] = field(default_factory=set)  # suffixes of files that are no images
    links: set[str] = field(default_factory=set)  # names of symbolic links, which may lead anywhere
    missing: str = ""  # why the folder itself cannot be looked into


def scan(folder: Path) -> Scan:
    """Looks once. Hidden and unfinished files are passed over, and what vanishes meanwhile; links are not followed."""
    found = Scan()
    try:
        os.scandir(folder).close()
    except OSError as error:
        found.missing = error.strerror or str(error)
        return found
    for entry in _entries(folder):
        name = shown_name(Path(entry.path).relative_to(folder))
        suffix = Path(entry.name).suffix.lower()
        if entry.is_symlink():
            found.links.add(name)
        elif suffix not in IMAGE_SUFFIXES:
            found.strangers.add(suffix)
        elif look := _look(entry, name):
            found.images.append(look)
    return found


def shown_name(relative: Path) -> str:
    """A name that can be printed and stored: control characters and bytes that are no text are written out."""
    text = os.fsencode(relative.as_posix()).decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else f"\\x{ord(letter):02x}" for letter in text)


def _entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Everything below `folder` that may be a file, folders of our own flights left out."""
    folders = [os.fspath(folder)]
    while folders:
        for entry in _listing(folders.pop()):
            if entry.name.startswith(".") or Path(entry.name).suffix.lower() in _UNFINISHED:
                continue
            if _is_folder(entry):
                folders.append(entry.path)
            else:
                yield entry


def _listing(folder: str) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as listing:
            entries = list(listing)
    except OSError as error:  # gone, or not ours to read
        _note_unreadable(folder, error)
        return []
    return [] if any(entry.name == _LEDGER for entry in entries) else entries


def _note_unreadable(path: str, error: OSError) -> None:
    if not isinstance(error, FileNotFoundError):
        _note_once(path, error.strerror)


@lru_cache(maxsize=1000)
def _note_once(path: str, why: str | None) -> None:
    """Once for each: a watched folder is looked at four times a second."""
    logger.warning("%s cannot be looked at (%s): it is passed over", path, why)


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False)
    except OSError as error:  # a network mount that has been lost
        _note_unreadable(entry.path, error)
        return False


def _look(entry: os.DirEntry[str], name: str) -> Look | None:
    try:
        status = entry.stat(follow_symlinks=False)
    except OSError as error:
        _note_unreadable(entry.path, error)
        return None
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would wait for ever
        return None
    return Look(Path(entry.path), name, status.st_size, status.st_mtime_ns)
