"""Size of a picture by the head of its file, without reading the rest. Sources: ITU-T T.81, annex B; PNG 1.2."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from gcs_mosaic.frames.structure import StructureError, unpack

_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOFn, which contain the size
_MOST_SEGMENTS = 2000  # thermal cameras put 10 MB of data into some hundred before it


def picture_size(path: Path) -> tuple[int, int] | None:
    """(width, height) in px of a JPEG or PNG; None for other files, and for those that cannot be read."""
    try:
        with open(path, "rb", opener=_at_once) as file:
            head = file.read(24)
            if head.startswith(b"\x89PNG"):
                width, height = unpack(">II", head, 16)
                return width, height
            return _of_jpeg(file) if head.startswith(b"\xff\xd8") else None
    except (OSError, StructureError):
        return None


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # else opening a pipe without a writer would block


def _of_jpeg(file: BinaryIO) -> tuple[int, int] | None:
    at = 2
    for _ in range(_MOST_SEGMENTS):
        file.seek(at)
        head = file.read(9)
        mark, marker, length = unpack(">BBH", head, 0)
        if mark != 0xFF:
            return None
        if marker == 0xFF:  # fill bytes may precede a marker
            at += 1
        elif marker in _FRAMES:
            height, width = unpack(">HH", head, 5)
            return width, height
        else:
            at += 2 + max(length, 2)
    return None
