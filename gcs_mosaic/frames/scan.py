"""A single scan of a folder and its subfolders."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from gcs_mosaic.frames.passed_over import is_preview_folder

IMAGE_SUFFIXES = {".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff"}
VIDEO_SUFFIXES = {".mp4", ".m4v", ".mov", ".mkv", ".ts", ".mts", ".m2ts", ".mpg", ".mpeg", ".avi"}
BESIDE_VIDEOS = {".srt"}  # positions, for anchors: no frames, and nothing to wonder at
_UNFINISHED = (".part", ".tmp", ".partial", ".crdownload")
LEDGER = "flight.sqlite"  # a folder that contains it is one of our flights: its images are not new frames
# The lock is there before the ledger. One that was left in the folder of frames itself hides nothing: that folder was named.
OURS = (LEDGER, ".gcs-mosaic.lock")
# From scan to scan, 0.5 kB each: to parse a path takes ten times as long as to look at its file. Of more in a folder none is
# known from the scan before, and frames come half a minute late: a card of a season has 20,000.
NAMES_KEPT = 65_536


@dataclass(frozen=True, slots=True)
class Look:
    """A file's state at one time. `name` is its POSIX path relative to the folder, made printable."""

    path: Path
    name: str
    size: int
    modified_ns: int
    changed_ns: int = 0  # of its entry, where the system has that
    inode: int = 0

    @property
    def signature(self) -> tuple[int, ...]:
        """Changes when the file does, also where another of the same size takes its place within the clock's coarseness."""
        return self.size, self.modified_ns, self.changed_ns, self.inode


@dataclass(slots=True)
class Scan:
    """Result of a scan: images and videos by name and suffix only, and what was skipped."""

    images: list[Look] = field(default_factory=list)
    videos: list[Look] = field(default_factory=list)
    strangers: set[str] = field(default_factory=set)  # suffixes of files that are not images
    others: set[str] = field(default_factory=set)  # names of the files that are not taken
    previews: set[str] = field(default_factory=set)  # folders of small copies, which are not looked into
    links: set[str] = field(default_factory=set)  # names of symbolic links, which may lead anywhere
    unreadable: set[str] = field(default_factory=set)  # sentences: what could not be inspected, and why
    missing: str = ""  # why the folder itself cannot be read, as the end of a sentence
    device: int | None = None  # of the folder; None if it is missing

    def pass_over(self, path: str, error: OSError) -> None:
        """Note what could not be inspected; files that have vanished are not reported."""
        if not isinstance(error, FileNotFoundError):
            shown = shown_name(Path(path))
            self.unreadable.add(f"{shown} cannot be looked at ({error.strerror}): it is passed over")


def scan(folder: Path) -> Scan:
    """Scan once. Hidden, unfinished and vanishing files are skipped, and so are folders of previews below the folder itself;
    links are not followed."""
    found = Scan()
    try:
        os.scandir(folder).close()
        found.device = folder.stat().st_dev
    except OSError as error:
        how = "is gone" if error.errno in (errno.ENOENT, errno.ENOTDIR) else "cannot be read"
        found.missing = f"{how} ({error.strerror or error})"
        return found
    start = len(os.fspath(folder / "_")) - 1
    for entry in _entries(folder, found):
        path, name, suffix = _named(entry.path, start)
        if _is_link(entry, found):
            found.links.add(name)
        elif suffix in BESIDE_VIDEOS:
            continue
        elif suffix not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
            found.strangers.add(shown_name(Path(suffix)) if suffix else "")
            found.others.add(name)
        elif look := _look(entry, path, name, found):
            (found.videos if suffix in VIDEO_SUFFIXES else found.images).append(look)
    return found


def mount_of(folder: Path) -> tuple[Path, Path]:
    """The folder without links on the way, and where the disk that holds it is mounted."""
    real = folder.resolve()
    return real, next((path for path in (real, *real.parents) if os.path.ismount(path)), real)


@lru_cache(NAMES_KEPT)
def _named(path: str, start: int) -> tuple[Path, str, str]:
    """The path of a file, its name in the folder whose path ends at `start`, and its suffix."""
    named = Path(path[start:])
    return Path(path), shown_name(named), named.suffix.lower()


def shown_name(path: Path) -> str:
    """A name that can be printed and stored: control characters and undecodable bytes are escaped."""
    text = os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else f"\\x{ord(letter):02x}" for letter in text)


def _entries(folder: Path, found: Scan) -> Iterator[os.DirEntry[str]]:
    """Everything below `folder` that may be a file, except folders of our own flights."""
    named = os.fspath(folder)
    folders = [named]
    while folders:
        within = folders.pop()
        for entry in _listing(within, found, ours=(LEDGER,) if within == named else OURS):
            if entry.name.startswith(".") or entry.name.lower().endswith(_UNFINISHED):
                continue
            if not _is_folder(entry, found):
                yield entry
            elif is_preview_folder(entry.name):
                _note_previews(entry, Path(named), found)
            else:
                folders.append(entry.path)


def _note_previews(folder: os.DirEntry[str], root: Path, found: Scan) -> None:
    """The images that lie in it, not those of folders below: storage boxes keep a folder for each picture."""
    found.previews.add(shown_name(Path(folder.path).relative_to(root)))
    for entry in _listing(folder.path, found, ours=()):
        if Path(entry.name).suffix.lower() in IMAGE_SUFFIXES and not _is_link(entry, Scan()):
            found.others.add(shown_name(Path(entry.path).relative_to(root)))


def _listing(folder: str, found: Scan, ours: Collection[str]) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as listing:
            entries = list(listing)
    except OSError as error:  # gone, or no permission
        found.pass_over(folder, error)
        return []
    return [] if any(entry.name in ours for entry in entries) else entries


def _is_link(entry: os.DirEntry[str], found: Scan) -> bool:
    try:
        return entry.is_symlink()
    except OSError as error:
        found.pass_over(entry.path, error)
        return False


def _is_folder(entry: os.DirEntry[str], found: Scan) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False)
    except OSError as error:  # a lost network mount
        found.pass_over(entry.path, error)
        return False


def _look(entry: os.DirEntry[str], path: Path, name: str, found: Scan) -> Look | None:
    try:
        status = entry.stat(follow_symlinks=False)
    except OSError as error:
        found.pass_over(entry.path, error)
        return None
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would block for ever
        return None
    return Look(
        path,
        name,
        status.st_size,
        status.st_mtime_ns,
        status.st_ctime_ns,
        0 if os.name == "nt" else status.st_ino,
    )
