"""What a video says of itself, and sentences for files that are none. Without PyAV."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

EARLIEST_UTC = datetime(2000, 1, 1, tzinfo=UTC).timestamp()  # cameras without a set clock tell 1904 or 1970
MOST_BOXES = 10_000
MEND = "copy it again, or repair it with untrunc"
ENCRYPTED = "it is encrypted: give a recording that is not"
_CODECS = {"h264": "H.264", "hevc": "H.265", "mpeg2video": "MPEG-2"}
_TS_BYTES, _TS_SYNC, _TS_SCRAMBLED, _TS_PROBE = 188, 0x47, 0xC0, 1000  # packets of MPEG-TS


@dataclass(frozen=True, slots=True, kw_only=True)
class Described:
    """A video: size in pixels as it is stored, length and beginning (seconds since 1970) where they are known and believed."""

    codec: str
    width: int
    height: int
    duration_s: float | None
    pixel_aspect: float = 1.0
    utc: float | None = None

    @property
    def words(self) -> str:
        """For display."""
        return f"{_CODECS.get(self.codec, self.codec)}, {self.width} x {self.height}"


def creation_utc(metadata: Sequence[Mapping[str, str]]) -> float | None:
    """When the recording began, if that is told and can be true; of several tags the one with a time zone first."""
    for tag in ("com.apple.quicktime.creationdate", "creation_time", "date"):
        for values in metadata:
            utc = _utc(values.get(tag, ""))
            if utc is not None and EARLIEST_UTC <= utc <= time.time() + 86400:
                return utc
    return None


def _utc(text: str) -> float | None:
    try:
        told = datetime.fromisoformat(text.strip())
        return (told if told.tzinfo else told.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None


def no_video(path: Path, kinds: Sequence[str]) -> str:
    """Why there is no video in a file that could be opened; `kinds` of the streams that are there."""
    if any(at + size > path.stat().st_size for at, size in _boxes_at(path)):
        return f"the recording was not finished (its end is missing): {MEND}"
    if "audio" in kinds:
        return "it holds sound only, no video: give the recording of the camera that looks down"
    return "it holds no video: see whether the file was copied as a whole"


def unopened(path: Path, error: str) -> str:
    """Why FFmpeg cannot open a file, by what is in it."""
    size = path.stat().st_size if path.is_file() else 0
    if not size:
        return "the file is empty: copy it again"
    boxes = [name for name, _ in top_boxes(path)]
    if boxes and boxes[0] in (b"ftyp", b"wide", b"mdat", b"free", b"skip") and b"moov" not in boxes:
        return f"the recording was not finished (no moov): {MEND}"
    if b"moov" in boxes:
        return f"it is damaged ({error}): {MEND}"
    return f"it is no video that can be read ({error}): give MP4, MOV, MKV or TS"


def top_boxes(path: Path) -> Iterator[tuple[bytes, int]]:
    """Names and sizes of the boxes of an MP4 or MOV file, as far as they are there (ISO 14496-12)."""
    with path.open("rb") as file:
        end, at = file.seek(0, os.SEEK_END), 0
        for _ in range(MOST_BOXES):
            file.seek(at)
            head = file.read(16)
            if len(head) < 8:
                return
            size, name = int.from_bytes(head[:4]), head[4:8]
            size = int.from_bytes(head[8:16]) if size == 1 else end - at if size == 0 else size
            if size < 8 or not name.isalnum():
                return
            yield name, size
            at += size
            if at >= end:
                return


def _boxes_at(path: Path) -> Iterator[tuple[int, int]]:
    """Where each box begins, and its size."""
    at = 0
    for _, size in top_boxes(path):
        yield at, size
        at += size


def is_scrambled(path: Path) -> bool:
    """Whether most packets of a transport stream are."""
    with path.open("rb") as file:
        data = file.read(_TS_BYTES * _TS_PROBE)
    heads = [data[at : at + 4] for at in range(0, len(data) - 4, _TS_BYTES) if data[at] == _TS_SYNC]
    scrambled = sum(bool(head[3] & _TS_SCRAMBLED) for head in heads)
    return len(heads) * _TS_BYTES > len(data) // 2 and scrambled > len(heads) // 2
