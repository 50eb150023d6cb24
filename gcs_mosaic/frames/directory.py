"""Frames from a watched folder. Uses polling: file events get lost, and network mounts deliver none."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal, TypeAlias

from gcs_mosaic.errors import UsageError
from gcs_mosaic.even_clock import even_utc, set_by
from gcs_mosaic.frames.appearance import Appearances, Pause
from gcs_mosaic.frames.cameras import Cameras
from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.frames.decoding.proof import Proof, decodes_here, loads_here
from gcs_mosaic.frames.files import frames_in as frames_in
from gcs_mosaic.frames.files import name_order
from gcs_mosaic.frames.integrity import image_size
from gcs_mosaic.frames.multiband.shots import BandShots, Load
from gcs_mosaic.frames.passed_over import Kinds, PassedOver, stem_of
from gcs_mosaic.frames.pending_file import Candidate, Prove, Unread, file_and_version
from gcs_mosaic.frames.previews import Previews
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.scan import Look, Scan, mount_of, scan
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.frames.shot_names import is_band, shot_file
from gcs_mosaic.frames.video.watched import WatchedVideos
from gcs_mosaic.messages import DamagedFile, Frame, Notice, OtherFile, SourceReport, Topic

REPORT_EACH_S = 1.0
AGAIN_S = 0.01  # delay of the scan after one that found a new or changed file: most are complete by then
AGAIN_SHARE, LOOKING_SHARE = 0.2, 0.1  # maximum shares of time for such scans and for all others

SLICE_S = 1.0  # of reading files, before it is looked whether newer ones have come
AGAIN_AFTER_FAILURE_S = 2.0

logger = logging.getLogger(__name__)

CLOCK_OFF_S = 3600.0  # a camera's clock further off than this is set to another time, or another time zone

Item: TypeAlias = Frame | DamagedFile | OtherFile | Notice | SourceReport


@dataclass(frozen=True, slots=True)
class Taken:
    """The newest version of a file accepted before a restart: its number, size in bytes and time."""

    version: int
    size: int
    modified: float  # seconds since 1970


NOTHING_TAKEN: Mapping[str, Taken] = MappingProxyType({})


def watch(
    folder: Path,
    stop: threading.Event,
    settings: FolderSettings | None = None,
    taken: Mapping[str, Taken] | None = None,
    decode: DecodeSettings | None = None,
    videos: WatchedVideos | None = None,
) -> Iterator[Item]:
    """Frames as they become complete in `folder` and below, until `stop` is set; a missing folder is created.

    A file is ready when two scans find it unchanged and it is complete. One of which more may come (it has no end marker, for
    example) is ready when it stands still and decodes whole, in a process with the limits of `decode`. Files that become
    ready in one scan are sorted by time, then by name. `taken`: files of a resumed flight by name; all others are new, unless
    they are older than all of these and than the settings allow. `videos` reads recorded ones. Raises UsageError immediately
    for a path that cannot be a folder.
    """
    settings = settings or FolderSettings()
    made = _make_folder(folder)
    proof = Proof(decode, settings.max_pixels)
    videos = videos or WatchedVideos(settings, StreamSettings(), {})
    return _watching(FolderWatch(folder, settings, time.time(), taken, proof, videos, proof.load), made, stop, proof)


def _watching(watched: FolderWatch, made: list[Item], stop: threading.Event, proof: Proof) -> Iterator[Item]:
    yield from made
    try:
        with closing(proof):
            yield from _polling(watched, stop)
    finally:
        if unread := watched.close():
            logger.warning("%s", unread)


def _polling(watched: FolderWatch, stop: threading.Event) -> Iterator[Item]:
    while not stop.is_set():
        try:
            for item in watched.poll(time.monotonic()):
                yield item
                if stop.is_set():
                    break
        except Exception as error:
            logger.exception("a look at the watched folder has failed")
            yield from watched.failed(error)
            stop.wait(AGAIN_AFTER_FAILURE_S)
        stop.wait(watched.look_again_s)
    yield from watched.rest()


def _make_folder(folder: Path) -> list[Item]:
    if folder.is_dir():
        return []
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise UsageError(
            f"--watch {str(folder)!r} can be no folder ({error.strerror}): give a folder in which the frames appear."
        ) from error
    return [Notice(source=str(folder), level="info", text=f"made the folder {folder}, which was not there")]


class FolderWatch:
    """State of every file in the folder; each `poll` is one scan."""

    def __init__(
        self,
        folder: Path,
        settings: FolderSettings,
        started_utc: float,
        taken: Mapping[str, Taken] | None = None,
        prove: Prove = decodes_here,
        videos: WatchedVideos | None = None,
        load: Load = loads_here,
    ) -> None:
        self._folder, self._settings, self._prove, self._videos = folder, settings, prove, videos
        # Files that arrived unwatched are no older than the flight, even if the camera's clock is wrong.
        oldest = min((one.modified for one in (taken or {}).values()), default=math.inf)
        self._oldest_ns = min(started_utc - settings.from_age_s, oldest) * 1e9
        self._candidates: dict[Path, Candidate] = {}
        self._appearances = Appearances()
        self._scanned: float | None = None  # when the last scan began
        self._before = NOTHING_TAKEN if taken is None else taken
        self._versions = {name: one.version for name, one in self._before.items()}
        self._cameras, self._passed_over, self._previews = Cameras(settings.cameras), PassedOver(), Previews()
        self._cameras.resume(self._before)
        is_asked = settings.bands == "together"
        self._shots = BandShots(load, self._cameras.band_of) if is_asked else None
        self._has_left = False  # some that were ready wait for the next scan
        self._polls = self._left = self._left_lately = self._taken = self._gaps = self._changed = 0
        self._clock_off_s: float | None = None
        self._kinds: Kinds = ()
        self._counts_due = -math.inf
        self._said: set[str] = set()
        self._said_doubt = self._said_old = False
        self._unread: set[Path] = set()  # files that cannot be read now
        self._damaged: set[Path] = set()  # that have not come whole since
        self._device: int | None = None  # where images were seen last
        self._mount: tuple[Path, Path] | None = None  # of that, as `mount_of` tells it
        self._beneath: set[tuple[int, ...]] | None = None  # files that were below that mount when its disk went
        self._missing = False
        self._since_utc = started_utc
        self._last_utc: float | None = None
        self._reported: tuple[SourceReport, float] | None = None
        self.look_again_s = settings.poll_s  # delay until the next scan

    def poll(self, now: float) -> Iterator[Item]:
        """Items that are ready, and notices, at the monotonic time `now`."""
        start, changed = time.perf_counter(), self._changed
        found = scan(self._folder)
        self._polls += 1
        pause = Pause(now if self._scanned is None else self._scanned, now + time.perf_counter() - start)
        self._scanned = now
        ready = [look for look in found.images if self._is_ready(look, now, pause)]
        took_s = time.perf_counter() - start
        self.look_again_s = self._wait_s(took_s, changed=self._changed > changed)
        self._forget_vanished(found)
        yield from self._presence(found)
        yield from self._remarks(found)
        yield from self._take_all(sorted(ready, key=_written_order), now)
        yield from self._due(now)
        if self._polls == 2:
            # That a file was there at the start says something of its event.
            yield from self._put_together(self._cameras.all_held(), now)
            yield self._first_look()
        if self._videos is not None:
            yield from self._of_videos(self._videos, found, now)
        yield from self._report(found, now)

    def rest(self) -> Iterator[Item]:
        """What waits for other files of its shot, as no more are sought; of bands the reference alone: registering takes time."""
        yield from self._cameras.all_held()
        if self._shots is not None:
            yield from self._shots.rest()

    def close(self) -> str:
        """End; returns what to say of what is not read to its end."""
        return "" if self._videos is None else self._videos.close()

    def _of_videos(self, videos: WatchedVideos, found: Scan, now: float) -> Iterator[Item]:
        for item in videos.items(found.videos, self._oldest_ns, now):
            if isinstance(item, Frame):
                self._taken += 1
                self._last_utc = even_utc()
            yield item

    def failed(self, error: Exception) -> Iterator[Notice]:
        """No failure ends the watching; each kind is said once."""
        text = f"{self._folder} could not be looked at ({type(error).__name__}); it is looked at again"
        yield from self._once("error", text)

    def _take_all(self, ready: list[Look], now: float) -> Iterator[Item]:
        """Of many, as when a card is copied, some: what comes while the flight goes on is not to wait for all of them."""
        until = time.monotonic() + SLICE_S
        if self._has_left:
            ready = ready[-1:] + ready[:-1]  # the newest first
        for at, look in enumerate(ready):
            if at and time.monotonic() > until:
                self._has_left, self.look_again_s = True, 0.0
                return
            yield from self._take(look, now)
        self._has_left = False

    def _wait_s(self, took_s: float, *, changed: bool) -> float:
        poll_s = self._settings.poll_s
        return max(min(AGAIN_S, poll_s), took_s / AGAIN_SHARE) if changed else max(poll_s, took_s / LOOKING_SHARE)

    def _is_ready(self, look: Look, now: float, pause: Pause) -> bool:
        candidate = self._candidates.get(look.path)
        if candidate is None:
            candidate = self._candidates[look.path] = Candidate(self._settings)
            if self._polls == 1 and look.modified_ns < self._oldest_ns:
                self._left += 1
                self._left_lately += look.changed_ns >= self._oldest_ns
                candidate.leave(look)
            elif self._was_taken(look):
                candidate.leave(look)
        if candidate.is_changed(look):
            self._changed += 1
            candidate.appeared = pause
            self._previews.changed(look.path)
        return candidate.is_ready(look, now)

    def _was_taken(self, look: Look) -> bool:
        before = self._before.get(look.name)
        if before is None or look.modified_ns / 1e9 != before.modified:
            return False
        # Of a frame that was made of several bands the size is not that of the file.
        return look.size == before.size or is_band(look.name, shot_file(look.name))

    def _take(self, look: Look, now: float) -> Iterator[Item]:
        item = self._candidates[look.path].take(look, now, self._versions.get(look.name, 0) + 1, self._prove)
        if isinstance(item, DamagedFile):
            self._damaged.add(look.path)
        if isinstance(item, Unread):
            yield from self._unread_now(look, item)
            return
        self._unread.discard(look.path)
        if isinstance(item, Frame):
            self._damaged.discard(look.path)
            item = self._dated(item, self._candidates[look.path])
            for frame in self._previews.take(item, image_size(item.data or b""), now):
                yield from self._accepted(frame, now)
        elif item is not None:
            yield item
        if isinstance(item, Frame):
            yield from self._doubted(item.name, self._candidates[look.path].doubt)
            yield from self._of_long_ago(item)

    def _accepted(self, frame: Frame, now: float) -> Iterator[Item]:
        name, version = file_and_version(frame.name)
        self._versions[name] = version
        self._taken += 1
        self._last_utc = even_utc()
        yield from self._put_together(self._cameras.take(frame, image_size(frame.data or b""), now), now)

    def _put_together(self, sorted_files: Iterator[Frame | OtherFile], now: float) -> Iterator[Item]:
        """Bands of one shot become one frame."""
        for item in sorted_files:
            yield from (item,) if self._shots is None else self._shots.take(item, now)

    def _due(self, now: float) -> Iterator[Item]:
        """What has waited for other files of its shot, or for the rest of itself."""
        for frame in self._previews.due(now):
            yield from self._accepted(frame, now)
        yield from self._put_together(self._cameras.due(now), now)
        if self._shots is not None:
            yield from self._shots.due(now)

    def _doubted(self, name: str, doubt: str) -> Iterator[Notice]:
        """Say once why frames come later than they could."""
        if doubt and not self._said_doubt:
            self._said_doubt = True
            text = f"{name} decodes whole, but {doubt}: such files are taken when they have not changed for"
            text += f" {self._settings.damaged_after_s:g} s (frames: {{damaged_after_s: …}})"
            yield Notice(source=str(self._folder), level="info", text=text)

    def _of_long_ago(self, frame: Frame) -> Iterator[Notice]:
        """Say once that a card with an earlier flight may have been put in: its frames are mapped with those of this one."""
        # Of a computer whose clock was set back meanwhile the times of new files are earlier by as much.
        hours = (self._oldest_ns / 1e9 + min(0.0, set_by()) - frame.modified) / 3600
        if self._polls > 1 and hours > 0 and not self._said_old:
            self._said_old = True
            before = f"{math.ceil(hours)} h" if hours < 72 else f"{hours / 24:,.0f} days"
            text = f"{frame.name} was written {before} before this flight began, and others may be: if they are of "
            text += (
                "an earlier flight, take that card out and begin anew (--new); if the camera's clock is wrong, set it"
            )
            yield Notice(source=str(self._folder), level="warning", text=text)

    def _dated(self, frame: Frame, candidate: Candidate) -> Frame:
        pause = candidate.appeared
        if pause is None:
            return frame
        if pause.is_short and self._polls > 1:
            self._clock_off_s = time.time() - frame.modified
        # What was waited for came when it was last seen to change, not when it was believed.
        read_at = min(pause.end, frame.received) if candidate.doubt else frame.received
        utc_of_zero = time.time() - time.monotonic()
        return replace(frame, received=self._appearances.dated(pause, frame.modified, read_at, utc_of_zero))

    def _unread_now(self, look: Look, unread: Unread) -> Iterator[Notice]:
        """Say once that files cannot be read now, and again only if all could be read in between."""
        if not self._unread:
            text = f"files in {self._folder} {unread.reason}: they are tried again"
            yield Notice(source=str(self._folder), level="warning", text=text)
        self._unread.add(look.path)

    def _forget_vanished(self, found: Scan) -> None:
        there = {look.path for look in found.images}
        for path in [path for path, known in self._candidates.items() if path not in there]:
            if not self._candidates[path].worth_keeping:
                del self._candidates[path]

    def _remarks(self, found: Scan) -> Iterator[Notice]:
        for text in sorted(found.unreadable):
            yield from self._once("warning", text)
        for suffix in sorted(found.strangers):
            kind = f"files ending in {suffix}" if suffix else "files without an ending"
            yield from self._once("info", f"{kind} are not images (JPEG, PNG, TIFF) or videos and are left alone")
        for name in sorted(found.previews):
            yield from self._once("info", f"{name} is a folder of small copies by its name: it is not looked into")
        for name in sorted(found.links)[:1]:
            yield from self._once("warning", f"{name} is a symbolic link; links are not followed")

    def _report(self, found: Scan, now: float) -> Iterator[SourceReport]:
        self._count_passed_over(found, now)
        report = SourceReport(
            kind="folder",
            name=str(self._folder),
            state="missing" if self._missing else "watching",
            since_utc=self._since_utc,
            last_seen_utc=self._last_utc,
            seen=len(found.images) + len(found.videos),
            taken=self._taken_as_frames,
            damaged=len(self._damaged),
            gaps=self._gaps,
            passed_over=self._kinds,
            left=self._left,
            left_lately=self._left_lately,
            clock_off_s=self._clock_off_s if abs(self._clock_off_s or 0.0) >= CLOCK_OFF_S else None,
            cameras=self._cameras.counts if self._shots is None else self._shots.counted(self._cameras.counts),
            reading="" if self._videos is None else self._videos.reading,
        )
        before = self._reported
        is_news = before is None or (report != before[0] and now - before[1] >= REPORT_EACH_S)
        if is_news or (before and before[0].state != report.state):
            self._reported = (report, now)
            yield report

    def _count_passed_over(self, found: Scan, now: float) -> None:
        """Less often than it is looked for frames: of thousands of files it takes milliseconds."""
        if now < self._counts_due:
            return
        self._counts_due = now + REPORT_EACH_S
        stems = {stem_of(look.name) for look in found.images} if found.others else set[str]()
        self._kinds = self._passed_over.kinds(found.others, stems, self._is_old)

    def _is_old(self, name: str) -> bool:
        try:
            return (self._folder / name).stat().st_mtime_ns < self._oldest_ns
        except OSError:  # gone, or of a name that is only shown so
            return True

    def _presence(self, found: Scan) -> Iterator[Notice]:
        """Report when the folder disappears (card removed, mount lost) and when it returns."""
        missing = found.missing or self._unmounted(found)
        if bool(missing) == self._missing:
            return
        self._missing, self._since_utc = bool(missing), even_utc()
        self._gaps += self._missing
        folder = str(self._folder)
        if self._missing:
            text = f"the folder {folder} {missing}: bring it back; the flight goes on, and takes what it missed"
            yield Notice(source=folder, level="error", text=text)
        else:
            yield Notice(source=folder, level="info", text=f"the folder {folder} is back")

    def _unmounted(self, found: Scan) -> str:
        """Where a disk with images was mounted, the folder below its mount is no folder of frames until one is written there;
        that of another disk in its place is one, such as of the next card."""
        if found.device == self._device:
            self._beneath = None
            return ""
        if self._mount is not None:
            (before, mounted), (now, at) = self._mount, mount_of(self._folder)
            there = {look.signature for look in found.images}
            if now == before and at != mounted and at in mounted.parents:
                self._beneath = there if self._beneath is None else self._beneath
                if there <= self._beneath:
                    shows = "shows what lies below its mount" if there else "is empty"
                    return f"{shows}, its disk is gone"
        if found.images:
            self._device, self._mount, self._beneath = found.device, mount_of(self._folder), None
        return ""

    @property
    def _taken_as_frames(self) -> int:
        return max(0, self._taken - self._previews.again - self._cameras.left_out)

    def _once(self, level: Literal["info", "warning", "error"], text: str) -> Iterator[Notice]:
        if text not in self._said:
            self._said.add(text)
            yield Notice(source=str(self._folder), level=level, text=text)

    def _first_look(self) -> Notice:
        self._left += 0 if self._videos is None else self._videos.left
        count, left = self._taken_as_frames, ""
        if self._left == 1:
            left = "; 1 older one is left alone (--from start takes it)"
        elif self._left:
            left = f"; {self._left} older ones are left alone (--from start takes them)"
        there = "1 frame was there" if count == 1 else f"{count} frames were there"
        text = f"watching {self._folder}: {there}{left}"
        return Notice(source="frames", level="info", text=text, topic=Topic.FIRST_LOOK)


def _written_order(look: Look) -> tuple[object, ...]:
    """Of files that came together: by when they were written, then by their names in natural order, a copy after its original."""
    return look.modified_ns, name_order(str(Path(look.name).with_suffix(""))), look.name
