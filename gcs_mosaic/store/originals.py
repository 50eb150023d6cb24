"""Keeps the original frames of a flight as they were on arrival.

A camera in flight may rewrite a file that it has finished, and a hard link would follow: so frames are copied and
checked against their hash, unless the folder is finished (nobody writes there any more) or disk space is
short. Then they are linked, and where that is impossible (another disk) not kept until there is room again.
"""

from __future__ import annotations

import errno
import hashlib
import logging
import os
import shutil
import threading
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Literal

from gcs_mosaic.messages import Frame, Notice, Topic, content_hash
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite, make_folder, sync_file, sync_folder, write_beside

if TYPE_CHECKING:
    from gcs_mosaic.store.records import FrameRecord

logger = logging.getLogger(__name__)

GB = 10**9
AGAIN_SHARE = 1 / 20  # of the reserve: this much more must be free before originals are copied again
# Errors that come from a frame's name, not from the disk: waiting would not help.
OF_THE_NAME = (errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EINVAL, errno.EILSEQ)
ORDINARY_BYTES = 256_000_000  # up to which an original is read to see whether it is what came, whatever the ledger says
LONGEST_PART = 200  # bytes of UTF-8; most file systems allow 255, and a temporary name is a little longer


@dataclass(frozen=True, slots=True, kw_only=True)
class OriginalsSettings:
    """How original frames are kept."""

    # "copy" is always safe. "link" takes no space, but follows a file that is rewritten.
    keep: Literal["copy", "link"] = "copy"
    # Beyond this, frames are only linked, which takes no space; reported. A long day is about 5 000 frames of 5 MB.
    budget_gb: float = 50.0
    # Disk space reserved for the map (about 1 GB for a flight), but at most half of what is free when the flight begins; below
    # it, frames are only linked.
    reserve_gb: float = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptOriginal:
    """An original is at `path` (POSIX, relative to the output folder)."""

    path: str
    linked: bool
    notice: Notice | None  # issued once, when the budget or the disk's reserve is reached, or there is room again


@dataclass(frozen=True, slots=True, kw_only=True)
class NotKept:
    """Why a frame's original was not kept; `for_lack_of_room`: it may be kept later."""

    reason: str
    notice: Notice | None
    for_lack_of_room: bool = False


class Originals:
    """The folder `frames` of one output folder. Its files are never changed or overwritten. Thread-safe.

    A kept original has been synced to disk: a ledger row may name it.
    """

    def __init__(self, out: Path, settings: OriginalsSettings | None = None) -> None:
        self.out = out
        self.settings = settings or OriginalsSettings()
        self._is_short = False
        self._ahead: dict[str, KeptOriginal] = {}  # kept before `keep` was called, by content hash
        self._lock = threading.Lock()
        self._measure()

    def keep_ahead(self, frame: Frame) -> Frame:
        """Keep a frame for which `keep` will be called later; returns it as kept, or unchanged if there is no space now."""
        with self._lock:
            if frame.content_hash in self._ahead:
                return frame
            try:
                if self._shortage(frame.size) is not None:
                    return frame
                kept = self._keep(frame)
            except (CannotWrite, OSError):  # `keep` waits until the folder is back; raising would end the source
                logger.debug("%s cannot be kept now", frame.name, exc_info=True)
                return frame
            if isinstance(kept, NotKept):  # there may be space, or the file may be readable, when its turn comes
                return frame
            self._ahead[frame.content_hash] = kept
        return replace(frame, path=self.out / kept.path)

    def keep(self, frame: Frame) -> KeptOriginal | NotKept:
        """Keep one frame. Raises DiskFull and OSError."""
        kept = self._ahead.pop(frame.content_hash, None)  # does not wait for other frames being kept ahead
        if kept is not None:
            return kept
        with self._lock:
            return self._ahead.pop(frame.content_hash, None) or self._keep(frame)

    def forget_lost(self) -> None:
        """Forget files that are no longer there: the folder has been made anew."""
        with self._lock:
            self._ahead = {
                one: kept for one, kept in self._ahead.items() if inside.is_file(self.out / kept.path, self.out)
            }
            self._measure()

    def _measure(self) -> None:
        self.used = bytes_below(self.out / "frames", self.out)
        room = shutil.disk_usage(self.out).free + self.used
        self.reserve = min(int(self.settings.reserve_gb * GB), room // 2)

    def _keep(self, frame: Frame) -> KeptOriginal | NotKept:
        shortage = self._shortage(frame.size)
        target = free_place(self.out / relative_place(frame.name), frame.content_hash, self.out)
        reason = None
        linked = (self.settings.keep == "link" or shortage is not None) and link(frame.path, target, self.out)
        notice = self._say_change(shortage, kept=linked)
        if not linked:
            reason = shortage or self._copy(frame, target)
        if reason is not None:
            return NotKept(reason=reason, notice=notice, for_lack_of_room=shortage is not None)
        return KeptOriginal(path=target.relative_to(self.out).as_posix(), linked=linked, notice=notice)

    def _copy(self, frame: Frame, target: Path) -> str | None:
        """Copy the frame's file; returns the reason if that fails or the content has changed since the frame arrived."""
        if inside.exists(target, self.out):
            return None
        data = frame.data
        if data is None:
            try:
                data = inside.read_given(frame.path)
            except OSError as error:
                return f"the file could not be read again to keep it ({error.strerror})"
            if content_hash(data) != frame.content_hash:
                return "the file was written again before it could be kept"
        try:
            make_folder(target.parent, self.out, durable=True)
            write_beside(target, data, durable=True, root=self.out)
        except OSError as error:
            if error.errno not in OF_THE_NAME:
                raise
            return f"{target} could not be written ({error.strerror})"
        self.used += len(data)
        return None

    def _shortage(self, size: int) -> str | None:
        """Why this many bytes should no longer be copied."""
        free = shutil.disk_usage(self.out).free
        slack = AGAIN_SHARE if self._is_short else 0.0  # lest every other frame of a nearly full disk is said to fit
        if free - size < self.reserve * (1 + slack):
            return f"only {free / GB:.3g} GB are free on the disk ({self.reserve / GB:.3g} GB are kept for the map)"
        if self.used + size > self.settings.budget_gb * GB * (1 - slack):
            return f"the originals take {self.used / GB:.1f} GB, the budget is {self.settings.budget_gb:g} GB"
        return None

    def _say_change(self, shortage: str | None, *, kept: bool) -> Notice | None:
        """What has changed for the next frames, once."""
        if self._is_short == (shortage is not None):
            return None
        self._is_short = shortage is not None
        if shortage is None:
            text = "there is room again: originals are copied as before"
            return Notice(source="originals", level="info", text=text, topic=Topic.DISK)
        advice = "from now on frames are linked instead of copied: do not write again into their files"
        if not kept:
            advice = "from now on originals are not kept until there is room: leave the frames where they are"
        return Notice(source="originals", level="warning", text=f"{shortage}; {advice}", topic=Topic.DISK)


def is_intact(path: Path, expected_hash: str, root: Path | None = None) -> bool:
    """Whether an original is unchanged: a linked one may have been rewritten. `root` as for `read_intact`."""
    return read_intact(path, expected_hash, root) is not None


def read_intact(
    path: Path, expected_hash: str, root: Path | None = None, most: int = inside.LARGEST_FILE
) -> bytes | None:
    """The whole file, None if it has changed or cannot be read. `root`: the flight's folder for an original that lies in it; a
    file of the camera's may be reached by links. `most`: bytes."""
    try:
        data = inside.read_given(path, most) if root is None else inside.read(path, root, most)
    except OSError:
        logger.warning("the original %s cannot be read", path, exc_info=True)
        return None
    return data if content_hash(data) == expected_hash else None


def place_of(out: Path, original: str) -> Path | None:
    """Where an original is kept; None for a place outside the folder of originals, which no ledger of ours names."""
    parts = PurePosixPath(original).parts
    inner = parts[:1] == ("frames",) and len(parts) > 1 and ".." not in parts and "\0" not in original
    return out / original if inner else None


def original_bytes(out: Path, record: FrameRecord) -> bytes | None:
    """The original of a frame as it came; None if it is not kept, or is not what came."""
    path = place_of(out, record.original or "")
    if path is None or record.content_hash is None:
        return None
    return read_intact(path, record.content_hash, out, max(record.size or inside.LARGEST_FILE, ORDINARY_BYTES))


def relative_place(name: str) -> PurePosixPath:
    """Path under the output folder for a frame of this name; always inside `frames/`, whatever the name."""
    parts = [part for part in name.replace("\0", "_").replace("\\", "_").split("/") if part not in ("", ".", "..")]
    return PurePosixPath("frames", *[short(part) for part in parts or ["unnamed"]][-16:])


def short(part: str) -> str:
    """A path component short enough for every file system; different long names stay different."""
    if len(os.fsencode(part)) <= LONGEST_PART:
        return part
    mark = hashlib.blake2b(os.fsencode(part), digest_size=6).hexdigest()
    suffix = PurePosixPath(part).suffix[-12:]
    return f"{os.fsdecode(os.fsencode(part)[: LONGEST_PART // 2]).encode('ascii', 'replace').decode()}~{mark}{suffix}"


def free_place(target: Path, expected_hash: str, root: Path) -> Path:
    """`target`, or a sibling name if another image is kept there already."""
    if not inside.exists(target, root) or is_intact(target, expected_hash, root):
        return target
    return target.with_name(f"{target.stem}~{expected_hash[:12]}{target.suffix}")


def bytes_below(folder: Path, root: Path) -> int:
    """Size of all files in a folder."""
    found = (inside.status(path, root) for path in inside.files(folder, root))
    return sum(status.st_size for status in found if status is not None)


def link(source: Path, target: Path, root: Path) -> bool:
    """Hard link `target` to `source`; False if impossible (another disk, a file system without links)."""
    if inside.exists(target, root):
        return True
    try:
        make_folder(target.parent, root, durable=True)
        inside.link(source.resolve(), target, root)
        sync_file(target, root)
        sync_folder(target.parent)
    except OSError:
        logger.debug("%s cannot be linked", source, exc_info=True)
        return False
    return True
