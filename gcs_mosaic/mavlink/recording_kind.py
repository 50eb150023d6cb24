"""What kind of recording a file is, by its content; and which file beside it may have been meant."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Literal

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.parser import MARKERS, decode_packet, packet_length
from gcs_mosaic.mavlink.tlog import TIME

Kind = Literal["tlog", "dataflash", "dataflash text", "ulog"]

_LOOKED_THROUGH = 1 << 18  # bytes
_PACKETS = 64  # by which raw MAVLink is told from a telemetry log
_BESIDE = 3  # files named
_OTHERS = {
    rb"PK\x03\x04|PK\x05\x06": "a ZIP archive: unpack it",
    rb"\x1f\x8b": "compressed with gzip: unpack it",
    rb"7z\xbc\xaf|Rar!": "an archive: unpack it",
    rb"\xff\xd8\xff|\x89PNG|II[*+]\x00|MM\x00[*+]": "a picture",
    rb"....ftyp": "a video",
    rb"%PDF": "a PDF document",
    rb"SQLite format 3\x00": "a database",
}


def kind_of(path: Path) -> Kind:
    """Raises OSError, and UsageError for what cannot be replayed."""
    with path.open("rb") as file:
        head = file.read(_LOOKED_THROUGH)
    if head.startswith(b"ULog\x01\x12\x35"):
        return "ulog"
    if head.startswith(b"\xa3\x95"):
        return "dataflash"
    if re.match(rb"FMT, *128, *89,", head):
        return "dataflash text"
    if _is_raw(head):
        raise UsageError(
            f"{str(path)!r} is raw MAVLink without times, so when the pictures were taken is not known: give the telemetry "
            f"log (.tlog) of the flight{_beside(path)}."
        )
    if what := _other(head):
        raise UsageError(
            f"{str(path)!r} holds no MAVLink packet: give a recording (.tlog, or a log .BIN or .ulg of the autopilot); "
            f"this is {what}{_beside(path)}."
        )
    return "tlog"


def _is_raw(head: bytes) -> bool:
    """Whether packets follow each other without the eight bytes of a time between them."""
    packets, position = list[tuple[int, int]](), 0
    while (marker := MARKERS.search(head, position)) and len(packets) < _PACKETS:
        start = marker.start()
        end = start + packet_length(head, start)
        whole = end <= len(head) and decode_packet(head[start:end]) is not None
        position = end if whole else start + 1
        packets += [(start, end)] if whole else []
    if len(packets) == 1:
        return packets[0][0] < TIME.size
    gaps = [start - end for (_, end), (start, _) in pairwise(packets)]
    return gaps.count(0) > gaps.count(TIME.size)


def _other(head: bytes) -> str | None:
    for begins, what in _OTHERS.items():
        if re.match(begins, head, re.DOTALL):
            return what
    text = head[:4096]
    if text and all(byte >= 32 or byte in b"\t\r\n\f" for byte in text) and b"\xfd" not in text and b"\xfe" not in text:
        return "a text"
    return None if head else "empty"


def _beside(path: Path) -> str:
    """The telemetry logs in the same folder, that of the same name first, as the end of a sentence."""
    try:
        logs = [one for one in path.parent.iterdir() if one.suffix.lower() == ".tlog" and one != path and one.is_file()]
    except OSError:
        return ""
    logs.sort(key=lambda one: (not path.name.startswith(one.stem), one.name))
    if not logs:
        return ""
    named = [one for one in logs if path.name.startswith(one.stem)] or logs[:_BESIDE]
    return f"; the .tlog beside it: {', '.join(one.name for one in named[:_BESIDE])}"
