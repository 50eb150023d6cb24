"""Files below a folder that somebody else may have filled: the one door through which a flight's folder is touched.

The folder itself may be reached by links, as its owner names it. Below it no link is followed, on any part of a path, and only
regular files are opened: a link, a pipe or a device under one of our names is as good as a file that cannot be read. Whatever
is refused is an OSError. Paths are given whole, with the folder (`root`) below which they lie.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

BY_FOLDER = os.open in os.supports_dir_fd  # not on Windows, where each part of a path is looked at beforehand
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)  # a pipe without a writer would block
BINARY = getattr(os, "O_BINARY", 0) | getattr(os, "O_NOINHERIT", 0)
FOLDER = getattr(os, "O_PATH", os.O_RDONLY) | getattr(os, "O_DIRECTORY", 0)
MB = 10**6
LARGEST_FILE = 4000 * MB  # bytes that are read into memory at most; originals of one frame are smaller
HOLES_FROM = 64 * MB  # size from which a file is looked at for holes
LEAST_FILLED = 1 / 64  # share of it that lies on the disk; compressing file systems need a tenth or more
MOST_OPEN = 256  # folders kept open by one `OpenRoot`
DEEPEST = 64  # folders below the root that are looked into; names of originals have 16 parts at most


class OpenRoot:
    """A root whose inner folders stay open between uses, until `close`: for many files in a few folders, of which opening the way
    to each takes longer than writing it. For any thread.

    A folder that is moved or replaced meanwhile is used where it went; one that is gone is a FileNotFoundError until
    `make_folder` has made it anew. So it is meant for moments.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._open: dict[tuple[str, ...], int] = {}
        self._left: list[int] = []  # folders no longer used for what begins, but perhaps for what has begun

    def folder(self, parts: tuple[str, ...]) -> int | None:
        """The open folder of these parts below the root; None if none more may stay open. Raises OSError."""
        with self._lock:
            if parts not in self._open and len(self._open) + len(self._left) < MOST_OPEN:
                self._open[parts] = _opened(self.path, parts)
            return self._open.get(parts)

    def forget(self) -> None:
        """Open all folders anew."""
        with self._lock:
            self._left += self._open.values()
            self._open.clear()

    def close(self) -> None:
        """To be called when no thread uses it any more."""
        self.forget()
        while self._left:
            os.close(self._left.pop())


Root = Path | OpenRoot


def path_of(root: Root) -> Path:
    return root.path if isinstance(root, OpenRoot) else root


def read(path: Path, root: Path, most: int = LARGEST_FILE) -> bytes:
    """The whole file of at most so many bytes. Raises OSError."""
    with reading(path, root) as file:
        found = os.fstat(file.fileno())
        if found.st_size <= most and is_mostly_holes(found):
            raise OSError(errno.EFBIG, "nothing but holes", str(path))
        data = file.read(min(most, found.st_size) + 1)  # `read` sets aside as much as it is asked for
        if len(data) > found.st_size:  # it has grown meanwhile
            data += file.read(max(0, most + 1 - len(data)))
    if len(data) > most:
        raise OSError(errno.EFBIG, f"more than {most / MB:g} MB", str(path))
    return data


def read_given(path: Path, most: int = LARGEST_FILE) -> bytes:
    """The whole of a file that the user names, or the camera has written: links to it are followed. Raises OSError."""
    whole = path.resolve()
    return read(whole, whole.parent, most)


def reading(path: Path, root: Root) -> BinaryIO:
    """The open file. Raises OSError."""
    return os.fdopen(descriptor(path, root, os.O_RDONLY), "rb")


def descriptor(path: Path, root: Root, flags: int, mode: int = 0o666) -> int:
    """As `os.open`. Raises OSError."""
    with _above(path, root) as (name, folder):
        opened = os.open(name, flags | NO_LINK | AT_ONCE | BINARY, mode, dir_fd=folder)
    try:
        if not stat.S_ISREG(os.fstat(opened).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
    except BaseException:
        os.close(opened)
        raise
    return opened


def status(path: Path, root: Root) -> os.stat_result | None:
    """Of what lies there, links themselves included; None if nothing can be reached."""
    try:
        with _above(path, root) as (name, folder):
            return os.stat(name, dir_fd=folder, follow_symlinks=False)
    except OSError:
        return None


def is_mostly_holes(found: os.stat_result) -> bool:
    """Whether a large file takes next to no room on the disk: it is made to cost whoever reads it."""
    blocks = getattr(found, "st_blocks", None)  # not on Windows
    return blocks is not None and found.st_size > HOLES_FROM and blocks * 512 < found.st_size * LEAST_FILLED


def is_file(path: Path, root: Root) -> bool:
    """Whether a regular file lies there."""
    found = status(path, root)
    return found is not None and stat.S_ISREG(found.st_mode)


def is_folder(path: Path, root: Root) -> bool:
    """Whether a folder, not a link to one, lies there."""
    found = status(path, root)
    return found is not None and stat.S_ISDIR(found.st_mode)


def exists(path: Path, root: Path) -> bool:
    """Whether anything lies there, a link that leads nowhere included."""
    return status(path, root) is not None


def remove(path: Path, root: Root) -> None:
    """Remove a file, or a link itself; nothing is done where there is none. Raises OSError."""
    with suppress(FileNotFoundError), _above(path, root) as (name, folder):
        os.unlink(name, dir_fd=folder)


def move(source: Path, target: Path, root: Root) -> None:
    """Rename within the folder, as `os.replace`. Raises OSError."""
    with _above(source, root) as (old, here), _above(target, root) as (new, there):
        os.replace(old, new, src_dir_fd=here, dst_dir_fd=there)


def link(source: Path, target: Path, root: Path) -> None:
    """Make a hard link within the folder to a file anywhere, which is no link itself. Raises OSError."""
    with _above(target, root) as (name, folder):
        os.link(source, name, dst_dir_fd=folder)


def make_folder(path: Path, root: Root) -> list[Path]:
    """Make a folder and those above it up to the root; returns those that were made. Raises OSError."""
    if isinstance(root, OpenRoot):
        root.forget()
        root = root.path
    missing = [one for one in (path, *path.parents) if one != root and one.is_relative_to(root)]
    made: list[Path] = []
    for one in reversed(missing):
        with _above(one, root) as (name, folder):
            try:
                os.mkdir(name, dir_fd=folder)
                made.append(one)
            except FileExistsError:
                if not is_folder(one, root):
                    raise NotADirectoryError(errno.ENOTDIR, "a link or a file, not a folder", str(one)) from None
    return made


def remove_folder(path: Path, root: Path) -> None:
    """Remove a folder with all that it holds; nothing is followed, and what cannot be removed stays."""
    if is_folder(path, root):
        shutil.rmtree(path, ignore_errors=True)  # follows no link below; that none is above has been looked at


def files(under: Path, root: Path, deepest: int = DEEPEST) -> Iterator[Path]:
    """All regular files below a folder in order of their names, folder by folder."""
    return (path for path, found in entries(under, root, deepest) if is_plain(found))


def entries(under: Path, root: Path, deepest: int = DEEPEST) -> Iterator[tuple[Path, os.DirEntry[str]]]:
    """All that lies below a folder but the folders, in order of names; what cannot be listed is left out."""
    waiting = [(under, 0)] if under == root or is_folder(under, root) else []
    while waiting:
        folder, depth = waiting.pop()
        below: list[tuple[Path, int]] = []
        for entry in _listed(folder):
            if not _is_folder(entry):
                yield folder / entry.name, entry
            elif depth < deepest:
                below.append((folder / entry.name, depth + 1))
        waiting += reversed(below)


def is_plain(entry: os.DirEntry[str]) -> bool:
    """Whether this is a regular file, not a link, pipe or device."""
    try:
        return entry.is_file(follow_symlinks=False)
    except OSError:
        return False


def _listed(folder: Path) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return sorted(found, key=lambda entry: entry.name)
    except OSError:
        return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False)
    except OSError:
        return False


@contextmanager
def _above(path: Path, root: Root) -> Iterator[tuple[str, int | None]]:
    """How to name a file to the system: its name and the open folder above it. Raises OSError where the way leads through a link
    or out of the root."""
    kept, root = (root if isinstance(root, OpenRoot) else None), path_of(root)
    parts = _parts(path, root)
    if not BY_FOLDER:
        _refuse_links(root, parts)
        yield str(path), None
        return
    folder = None if kept is None else kept.folder(parts[:-1])
    if folder is not None:
        yield parts[-1], folder
        return
    folder = _opened(root, parts[:-1])
    try:
        yield parts[-1], folder
    finally:
        os.close(folder)


def _parts(path: Path, root: Path) -> tuple[str, ...]:
    try:
        parts = path.relative_to(root).parts
    except ValueError:
        raise FileNotFoundError(errno.ENOENT, f"not below {root}", str(path)) from None
    if not parts or ".." in parts or any("\0" in part for part in parts):
        raise FileNotFoundError(errno.ENOENT, f"no name below {root}", str(path))
    return parts


def _opened(root: Path, parts: tuple[str, ...]) -> int:
    """An inner folder, reached without following a link. To be closed."""
    folder = os.open(root, FOLDER)
    try:
        for part in parts:
            below = os.open(part, FOLDER | NO_LINK, dir_fd=folder)
            os.close(folder)
            folder = below
    except BaseException:
        os.close(folder)
        raise
    return folder


def _refuse_links(root: Path, parts: tuple[str, ...]) -> None:
    here = root
    for part in parts:
        here = here / part
        with suppress(FileNotFoundError):
            found = here.lstat()
            if stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) != 0:
                raise OSError(errno.ELOOP, "a link", str(here))
