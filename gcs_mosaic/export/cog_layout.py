"""A TIFF laid out as a Cloud-Optimized GeoTIFF: all directories, then the tiles of the coarsest overview, the picture's last.

So whoever reads it over a network has the directories with one request, and what is seen first lies first. The tiles themselves
are copied as they are. OGC 21-026, Cloud Optimized GeoTIFF 1.0.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO

import tifffile

TILE_OFFSETS, TILE_BYTES = 324, 325
LONG = 4  # TIFF's type of 32 bits
CLASSIC_BYTES = 0xFFFF_0000  # that offsets of 32 bits reach, with some to spare
# GDAL's note on the layout, behind the header: in which order the tiles are, and that nothing lies between them.
NOTE = b"LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nKNOWN_INCOMPATIBLE_EDITION=NO\n "
NOTE_HEAD = f"GDAL_STRUCTURAL_METADATA_SIZE={len(NOTE):06d} bytes\n".encode()


@dataclass(frozen=True, slots=True)
class _Tag:
    code: int
    type: int
    count: int
    data: bytes  # little-endian


@dataclass(frozen=True, slots=True)
class _Page:
    tags: tuple[_Tag, ...]  # without those that tell where tiles are
    offsets: tuple[int, ...]
    sizes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Form:
    """Classic TIFF or BigTIFF. Formats of a directory's number of entries, of an entry without its value, and of an offset."""

    header: bytes
    count: str
    entry: str
    offset: str
    offset_type: int  # TIFF's type of an offset

    @property
    def room(self) -> int:
        """Bytes of a value that stand in its entry."""
        return struct.calcsize(self.offset)


CLASSIC = _Form(b"II*\0", "<H", "<HHI", "<I", LONG)
BIG = _Form(b"II+\0\x08\0\0\0", "<Q", "<HHQ", "<Q", 16)


def as_cog(source: Path, target: Path) -> None:
    """Write a tiled little-endian TIFF again in that order: its first page is the picture, the others its overviews, the finest
    first."""
    with tifffile.TiffFile(source) as file:
        pages = [_page(page) for page in file.pages if isinstance(page, tifffile.TiffPage)]
    form = CLASSIC if source.stat().st_size < CLASSIC_BYTES else BIG
    lead = len(form.header) + form.room + len(NOTE_HEAD) + len(NOTE)
    lead += lead % 2
    sizes = [len(_directory(page, [0] * len(page.sizes), form, 0, 0)) for page in pages]
    starts = [lead, *(lead + size for size in accumulate(sizes))]
    places = _places(pages, starts[-1])
    with source.open("rb") as old, target.open("wb") as new:
        new.write((form.header + struct.pack(form.offset, lead) + NOTE_HEAD + NOTE).ljust(lead, b"\0"))
        for page, place, start, following in zip(pages, places, starts, [*starts[1:-1], 0], strict=False):
            new.write(_directory(page, place, form, start, following))
        for page in reversed(pages):
            _copy(old, new, page)


def _page(page: tifffile.TiffPage) -> _Page:
    file = page.parent.filehandle
    tags = []
    for tag in page.tags:
        if tag.code not in (TILE_OFFSETS, TILE_BYTES):
            file.seek(tag.valueoffset)
            tags.append(_Tag(tag.code, int(tag.dtype), tag.count, file.read(tag.valuebytecount)))
    return _Page(tuple(tags), tuple(page.dataoffsets), tuple(page.databytecounts))


def _places(pages: Sequence[_Page], start: int) -> list[list[int]]:
    """Where each page's tiles begin: those of the last page first. A tile without data is nowhere."""
    found: list[list[int]] = []
    for page in reversed(pages):
        ends = list(accumulate(page.sizes, initial=start))
        found.append([at if size else 0 for at, size in zip(ends, page.sizes, strict=False)])
        start = ends[-1]
    return found[::-1]


def _directory(page: _Page, places: Sequence[int], form: _Form, start: int, following: int) -> bytes:
    """A directory that begins at `start`, with the values of its tags behind it."""
    offsets = struct.pack(f"<{len(places)}{form.offset[-1]}", *places)
    counts = struct.pack(f"<{len(places)}I", *page.sizes)
    tags = [
        *page.tags,
        _Tag(TILE_OFFSETS, form.offset_type, len(places), offsets),
        _Tag(TILE_BYTES, LONG, len(places), counts),
    ]
    head = struct.pack(form.count, len(tags))
    length = len(head) + len(tags) * (struct.calcsize(form.entry) + form.room) + form.room
    entries, values = b"", b""
    for tag in sorted(tags, key=lambda one: one.code):
        entries += struct.pack(form.entry, tag.code, tag.type, tag.count)
        if len(tag.data) <= form.room:
            entries += tag.data.ljust(form.room, b"\0")
        else:
            entries += struct.pack(form.offset, start + length + len(values))
            values += tag.data + b"\0" * (len(tag.data) % 2)  # values begin at even places
    return head + entries + struct.pack(form.offset, following) + values


def _copy(old: BinaryIO, new: BinaryIO, page: _Page) -> None:
    for data in _tiles(old, page):
        new.write(data)


def _tiles(old: BinaryIO, page: _Page) -> Iterator[bytes]:
    for offset, size in zip(page.offsets, page.sizes, strict=True):
        old.seek(offset)
        yield old.read(size)
