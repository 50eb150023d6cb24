"""TIFF and BigTIFF: looks whether every directory and its strips or tiles lie within the file. Source: TIFF 6.0."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.frames.structure import StructureError, Whole, unpack

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _SAMPLES = 256, 257, 258, 259, 262, 277
_ORIENTATION = 274
_ROWS_PER_STRIP, _PLANAR, _TILE_WIDTH, _TILE_HEIGHT, _EXTRA, _FORMAT = 278, 284, 322, 323, 338, 339
_NUMBERS = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _SAMPLES, _ROWS_PER_STRIP, _PLANAR}
_NUMBERS |= {_TILE_WIDTH, _TILE_HEIGHT, _EXTRA, _FORMAT}
_PIECES = ((273, 279), (324, 325))  # (offsets, byte counts) of strips, of tiles
_COLOURS = {320, 347, 529, 530, 532}  # palette, JPEG's tables, YCbCr: what pixels depend on besides
_WANTED = {*_NUMBERS, *_PIECES[0], *_PIECES[1]}
_PALETTE, _ALPHA, _UNCOMPRESSED = 3, (1, 2), 1
# Those that every build of OpenCV reads, and names of others: a JPEG 2000 may come back black, as if all were well.
_READ = frozenset({_UNCOMPRESSED, 2, 3, 4, 5, 6, 7, 8, 32773, 32946})
_NAMES = {33003: "JPEG 2000", 33005: "JPEG 2000", 34712: "JPEG 2000", 34887: "LERC", 34892: "lossy JPEG as in DNG"}
_NAMES |= {34925: "LZMA", 50000: "Zstandard", 50001: "WebP", 50002: "JPEG XL", 52546: "JPEG XL"}
_NOISE = bytes(range(1, 256))
_LETTERS = {1: "B", 3: "H", 4: "I", 16: "Q"}  # field types: byte, short, long, long8
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_SIZES = {"B": 1, "H": 2, "I": 4, "Q": 8}
_MOST_DIRECTORIES = 64  # pages and overviews
_MOST_ENTRIES = 4096  # of a directory: cameras write a hundred
_MOST_NUMBERS = 65_536  # of a field of samples
EMPTY_END, EMPTY_STRIP = 512, 64  # bytes, of a file and of a compressed strip
_MOST_PIECES = 1_000_000  # of all pages: 400 megapixels in tiles of 32 x 32 are 0.4 million


@dataclass(frozen=True, slots=True)
class _Layout:
    """Number formats: byte order, and the struct letters of an offset and of a directory's count."""

    order: str
    offset: str
    count: str
    first: int  # position of the first directory's offset


@dataclass(frozen=True, slots=True)
class TiffPage:
    """Storage of a TIFF's first page; `pieces` are the (offset, bytes) of its strips or tiles, `piece_bytes` the maximum size
    of each when decompressed."""

    width: int
    height: int
    samples: int
    transparent: tuple[int, ...]  # indices of samples that are not bands, from 0
    bits: int  # per sample; the largest, if they differ
    formats: frozenset[int]  # 1: unsigned integer
    compression: int
    palette: bool
    planar: bool
    pieces: tuple[tuple[int, int], ...]
    piece_bytes: int


def tiff_header(data: bytes) -> Whole:
    """Size and bands of the first page; raises StructureError if its directory is not completely in the file."""
    pages = _pages(data)
    page, doubt = _first(pages)
    doubt = doubt or _lacking_in_others(pages, len(page.pieces))
    # One whose room was taken before it is written ends in zeros until it is whole; a black border does, too.
    empty_end = EMPTY_STRIP if _compressed(page) else EMPTY_END
    doubt = doubt or ("" if any(data[-empty_end:]) else "it ends in zeros")
    doubt = doubt or ("some of its strips are empty" if unwritten(data, page) else "")
    bands = 3 if page.palette else page.samples - len(page.transparent)
    return Whole(page.width, page.height, bands, max(page.bits, 8), doubt)


def first_page(data: bytes) -> TiffPage:
    """Storage of the first page; raises StructureError if its directory is not completely in the file."""
    return _first(_pages(data))[0]


def refuse_unread(page: TiffPage) -> None:
    """Raises StructureError if the page's compression is one that no decoder here reads."""
    if page.compression not in _READ:
        name = _NAMES.get(page.compression, f"number {page.compression}")
        raise StructureError(
            f"a TIFF compressed by {name} is not read, save it without compression, or as Deflate or LZW"
        )


def unwritten(data: bytes, page: TiffPage) -> float:
    """Share of the page's compressed strips or tiles that begin with zeros, as no compression does."""
    begins = [data[offset : offset + min(count, EMPTY_STRIP)] for offset, count in _compressed(page)]
    return sum(bool(begin) and not any(begin) for begin in begins) / max(len(begins), 1)


def continued_tiff(data: bytes, page: TiffPage) -> bytes | None:
    """The file with other bytes for the zeros in which compressed strips end: they are padding, or were never written. None if
    there are no such zeros."""
    other = bytearray(data)
    for offset, count in _compressed(page):
        end = min(offset + count, len(data))
        if end - offset >= EMPTY_STRIP and not any(data[end - EMPTY_STRIP : end]):
            begin = offset + len(data[offset:end].rstrip(b"\0"))
            other[begin:end] = _NOISE * ((end - begin) // len(_NOISE)) + _NOISE[: (end - begin) % len(_NOISE)]
    return None if other == data else bytes(other)


def _compressed(page: TiffPage) -> tuple[tuple[int, int], ...]:
    return () if page.compression == _UNCOMPRESSED else page.pieces


def as_stored(data: bytes) -> bytes:
    """The file with a first page that says its pixels are shown as they are stored: some decoders turn them otherwise."""
    layout, start = _layout(data)
    (entries,) = unpack(layout.order + layout.count, data, start)
    size, first = 4 + 2 * _SIZES[layout.offset], start + _SIZES[layout.count]
    for at in range(first, first + min(entries, _MOST_ENTRIES) * size, size):
        tag, kind = unpack(layout.order + "HH", data, at)
        value = at + size - _SIZES[layout.offset]
        if (tag, kind) == (_ORIENTATION, 3) and unpack(layout.order + "H", data, value) != (1,):
            return data[:value] + struct.pack(layout.order + "H", 1) + data[value + 2 :]
    return data


def _first(pages: Iterator[tuple[TiffPage, str]]) -> tuple[TiffPage, str]:
    found = next(pages, None)
    if found is None:
        raise StructureError("damaged: a TIFF without a picture")
    return found


def _lacking_in_others(pages: Iterator[tuple[TiffPage, str]], pieces: int) -> str:
    """What pages behind the first lack, if so."""
    lacking = ""
    try:
        for page, lacks in pages:
            pieces, lacking = pieces + len(page.pieces), lacking or lacks
            if pieces > _MOST_PIECES:
                break
    except StructureError as error:
        return str(error)
    if pieces > _MOST_PIECES:
        raise StructureError(f"damaged: a TIFF of more than {_MOST_PIECES} strips or tiles")
    return lacking


def _pages(data: bytes) -> Iterator[tuple[TiffPage, str]]:
    """Pages and overviews, and what each lacks. Raises StructureError at one whose directory is not in the file."""
    layout, directory = _layout(data)
    seen = set[int]()
    while directory and directory not in seen and len(seen) < _MOST_DIRECTORIES:  # a chain may be a circle
        seen.add(directory)
        fields, directory, lacking = _directory(data, layout, directory)
        pieces, beyond = _pieces(data, fields)
        yield _page(fields, pieces), lacking or beyond


def _layout(data: bytes) -> tuple[_Layout, int]:
    """And the first directory's offset."""
    order = "<" if data[:1] == b"I" else ">"
    big = unpack(order + "H", data, 2) == (43,)
    layout = _Layout(order, "Q", "Q", 8) if big else _Layout(order, "I", "H", 4)
    (directory,) = unpack(order + layout.offset, data, layout.first)
    return layout, directory


def _page(fields: dict[int, list[int]], pieces: list[tuple[int, int]]) -> TiffPage:
    def number(tag: int, usual: int) -> int:
        return max(fields.get(tag) or [usual])

    width, height, samples, bits = (number(tag, n) for tag, n in ((_WIDTH, 0), (_HEIGHT, 0), (_SAMPLES, 1), (_BITS, 1)))
    planar, extra = number(_PLANAR, 1) == 2, fields.get(_EXTRA, [])
    if len(extra) >= samples:
        extra = []  # of a field that cannot be true nothing is believed
    rows = number(_TILE_HEIGHT, min(number(_ROWS_PER_STRIP, height), height))
    return TiffPage(
        width=width,
        height=height,
        samples=samples,
        transparent=tuple(samples - len(extra) + i for i, kind in enumerate(extra) if kind in _ALPHA),
        bits=bits,
        formats=frozenset(fields.get(_FORMAT) or [1]),
        compression=number(_COMPRESSION, 1),
        palette=number(_PHOTOMETRIC, 1) == _PALETTE,
        planar=planar,
        pieces=tuple(pieces),
        piece_bytes=number(_TILE_WIDTH, width) * rows * (1 if planar else samples) * -(-bits // 8),
    )


def _directory(data: bytes, layout: _Layout, start: int) -> tuple[dict[int, list[int]], int, str]:
    """The fields needed from the directory at `start`, the offset of the next one, and what is beyond the file's end."""
    (entries,) = unpack(layout.order + layout.count, data, start)
    if entries > _MOST_ENTRIES:
        raise StructureError(f"damaged: a TIFF directory of {entries} entries")
    entry_size = 4 + 2 * _SIZES[layout.offset]
    first, lacking = start + _SIZES[layout.count], ""
    fields: dict[int, list[int]] = {}
    for at in range(first, first + entries * entry_size, entry_size):
        tag, kind = unpack(layout.order + "HH", data, at)
        values_at, count = _place(data, layout, at + 4, _WIDTHS.get(kind, 0))
        is_wanted = tag in _WANTED and kind in _LETTERS and tag not in fields
        if is_wanted and count > (_MOST_NUMBERS if tag in _NUMBERS else _MOST_PIECES):
            raise StructureError(f"damaged: a TIFF field of {count} numbers")
        if is_wanted:
            fields[tag] = list(unpack(f"{layout.order}{count}{_LETTERS[kind]}", data, values_at))
        elif values_at + count * _WIDTHS.get(kind, 0) > len(data):
            if tag in _COLOURS:
                raise StructureError(f"truncated: it ends after {len(data)} bytes")
            lacking = f"a field of it lies behind its end after {len(data)} bytes"
    behind = first + entries * entry_size
    if behind + _SIZES[layout.offset] > len(data):  # some do not write where no other follows
        return fields, 0, f"its directory ends with the file, after {len(data)} bytes"
    (following,) = unpack(layout.order + layout.offset, data, behind)
    return fields, following, lacking


def _place(data: bytes, layout: _Layout, at: int, width: int) -> tuple[int, int]:
    """Offset of an entry's values (in the entry itself if they fit) and their count."""
    (count,) = unpack(layout.order + layout.offset, data, at)
    at += _SIZES[layout.offset]
    if count * width > _SIZES[layout.offset]:
        (at,) = unpack(layout.order + layout.offset, data, at)
    return at, count


def _pieces(data: bytes, fields: dict[int, list[int]]) -> tuple[list[tuple[int, int]], str]:
    """Offsets and sizes of the page's strips or tiles; and what of them is not in the file."""
    for offsets, counts in _PIECES:
        places, sizes = fields.get(offsets, []), fields.get(counts, [])
        if not places:
            continue
        if len(places) != len(sizes):
            return [(place, max(len(data) - place, 0)) for place in places], "not all its strips tell their size"
        pieces = list(zip(places, sizes, strict=True))
        if any(place + size > len(data) for place, size in pieces):
            return pieces, f"truncated: it ends after {len(data)} bytes"
        return pieces, ""
    raise StructureError("damaged: a TIFF page without a picture")
