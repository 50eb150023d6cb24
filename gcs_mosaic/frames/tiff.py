"""TIFF and BigTIFF: checks that every directory and its strips or tiles lie within the file. Source: TIFF 6.0."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_mosaic.frames.structure import StructureError, Whole, unpack

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _SAMPLES = 256, 257, 258, 259, 262, 277
_ROWS_PER_STRIP, _PLANAR, _TILE_WIDTH, _TILE_HEIGHT, _EXTRA, _FORMAT = 278, 284, 322, 323, 338, 339
_NUMBERS = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _SAMPLES, _ROWS_PER_STRIP, _PLANAR}
_NUMBERS |= {_TILE_WIDTH, _TILE_HEIGHT, _EXTRA, _FORMAT}
_PIECES = ((273, 279), (324, 325))  # (offsets, byte counts) of strips, of tiles
_WANTED = {*_NUMBERS, *_PIECES[0], *_PIECES[1]}
_PALETTE, _ALPHA = 3, (1, 2)
_LETTERS = {1: "B", 3: "H", 4: "I", 16: "Q"}  # field types: byte, short, long, long8
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_SIZES = {"B": 1, "H": 2, "I": 4, "Q": 8}
_MOST_DIRECTORIES = 64  # pages and overviews
_MOST_ENTRIES = 4096  # of a directory: cameras write a hundred
_MOST_NUMBERS = 65_536  # of a field of samples
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
    """Size and bands of the first page; raises StructureError if any page is not completely in the file."""
    page = first_page(data)
    return Whole(
        page.width, page.height, 3 if page.palette else page.samples - len(page.transparent), max(page.bits, 8)
    )


def first_page(data: bytes) -> TiffPage:
    """Storage of the first page; raises StructureError if any page is not completely in the file."""
    order = "<" if data[:1] == b"I" else ">"
    big = unpack(order + "H", data, 2) == (43,)
    layout = _Layout(order, "Q", "Q", 8) if big else _Layout(order, "I", "H", 4)
    (directory,) = unpack(order + layout.offset, data, layout.first)
    pages, seen, pieces = list[TiffPage](), set[int](), 0
    while directory and directory not in seen and len(pages) < _MOST_DIRECTORIES:  # a chain may be a circle
        seen.add(directory)
        fields, directory = _directory(data, layout, directory)
        pages.append(_page(fields, _pieces(data, fields)))
        pieces += len(pages[-1].pieces)
        if pieces > _MOST_PIECES:
            raise StructureError(f"damaged: a TIFF of more than {_MOST_PIECES} strips or tiles")
    if not pages:
        raise StructureError("damaged: a TIFF without a picture")
    return pages[0]


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


def _directory(data: bytes, layout: _Layout, start: int) -> tuple[dict[int, list[int]], int]:
    """The fields needed from the directory at `start`, and the offset of the next one."""
    (entries,) = unpack(layout.order + layout.count, data, start)
    if entries > _MOST_ENTRIES:
        raise StructureError(f"damaged: a TIFF directory of {entries} entries")
    entry_size = 4 + 2 * _SIZES[layout.offset]
    first = start + _SIZES[layout.count]
    (following,) = unpack(layout.order + layout.offset, data, first + entries * entry_size)
    fields: dict[int, list[int]] = {}
    for at in range(first, first + entries * entry_size, entry_size):
        tag, kind = unpack(layout.order + "HH", data, at)
        values_at, count = _place(data, layout, at + 4, _WIDTHS.get(kind, 0))
        if tag in _WANTED and kind in _LETTERS and tag not in fields:
            if count > (_MOST_NUMBERS if tag in _NUMBERS else _MOST_PIECES):
                raise StructureError(f"damaged: a TIFF field of {count} numbers")
            fields[tag] = list(unpack(f"{layout.order}{count}{_LETTERS[kind]}", data, values_at))
    return fields, following


def _place(data: bytes, layout: _Layout, at: int, width: int) -> tuple[int, int]:
    """Offset of an entry's values (in the entry itself if they fit) and their count, all within the file."""
    (count,) = unpack(layout.order + layout.offset, data, at)
    at += _SIZES[layout.offset]
    if count * width > _SIZES[layout.offset]:
        (at,) = unpack(layout.order + layout.offset, data, at)
    if at + count * width > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return at, count


def _pieces(data: bytes, fields: dict[int, list[int]]) -> list[tuple[int, int]]:
    """Offsets and sizes of the page's strips or tiles, all within the file."""
    for offsets, counts in _PIECES:
        pieces = list(zip(fields.get(offsets, []), fields.get(counts, []), strict=False))
        if any(offset + count > len(data) for offset, count in pieces):
            raise StructureError(f"truncated: it ends after {len(data)} bytes")
        if pieces and len(fields[offsets]) == len(fields[counts]):
            return pieces
    raise StructureError("damaged: a TIFF page without a picture")
