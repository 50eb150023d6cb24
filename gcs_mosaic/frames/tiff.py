"""TIFF and BigTIFF: every directory, and every strip or tile it lists, lies within the file. Source: TIFF 6.0."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_mosaic.frames.structure import StructureError, unpack

_WIDTH, _HEIGHT = 256, 257
_PIECES = ((273, 279), (324, 325))  # (offsets, byte counts) of strips, of tiles
_WANTED = {_WIDTH, _HEIGHT, *_PIECES[0], *_PIECES[1]}
_LETTERS = {1: "B", 3: "H", 4: "I", 16: "Q"}  # field types: byte, short, long, long8
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_SIZES = {"B": 1, "H": 2, "I": 4, "Q": 8}
_MOST_DIRECTORIES = 64  # pages and overviews; a chain that bites its tail ends here


@dataclass(frozen=True, slots=True)
class _Layout:
    """How numbers are written: byte order, and the letters of an offset and of a directory's count."""

    order: str
    offset: str
    count: str
    first: int  # where the file says where its first directory is


def tiff_size(data: bytes) -> tuple[int, int]:
    """(width, height) of the first page; raises StructureError if any page is not completely in the file."""
    order = "<" if data[:1] == b"I" else ">"
    big = unpack(order + "H", data, 2) == (43,)
    layout = _Layout(order, "Q", "Q", 8) if big else _Layout(order, "I", "H", 4)
    (directory,) = unpack(order + layout.offset, data, layout.first)
    sizes: list[tuple[int, int]] = []
    while directory and len(sizes) < _MOST_DIRECTORIES:
        fields, directory = _directory(data, layout, directory)
        _check_pieces(data, fields)
        sizes.append((fields.get(_WIDTH, [0])[0], fields.get(_HEIGHT, [0])[0]))
    if not sizes:
        raise StructureError("damaged: a TIFF without a picture")
    return sizes[0]


def _directory(data: bytes, layout: _Layout, start: int) -> tuple[dict[int, list[int]], int]:
    """The fields we need of the directory at `start`, and where the next one is."""
    (entries,) = unpack(layout.order + layout.count, data, start)
    entry_size = 4 + 2 * _SIZES[layout.offset]
    first = start + _SIZES[layout.count]
    (following,) = unpack(layout.order + layout.offset, data, first + entries * entry_size)
    fields: dict[int, list[int]] = {}
    for at in range(first, first + entries * entry_size, entry_size):
        tag, kind = unpack(layout.order + "HH", data, at)
        values_at, count = _place(data, layout, at + 4, _WIDTHS.get(kind, 0))
        if tag in _WANTED and kind in _LETTERS and tag not in fields:
            fields[tag] = list(unpack(f"{layout.order}{count}{_LETTERS[kind]}", data, values_at))
    return fields, following


def _place(data: bytes, layout: _Layout, at: int, width: int) -> tuple[int, int]:
    """Where the values of an entry begin (in the entry itself if they fit) and how many there are, all in the file."""
    (count,) = unpack(layout.order + layout.offset, data, at)
    at += _SIZES[layout.offset]
    if count * width > _SIZES[layout.offset]:
        (at,) = unpack(layout.order + layout.offset, data, at)
    if at + count * width > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return at, count


def _check_pieces(data: bytes, fields: dict[int, list[int]]) -> None:
    for offsets, counts in _PIECES:
        pieces = list(zip(fields.get(offsets, []), fields.get(counts, []), strict=False))
        if any(offset + count > len(data) for offset, count in pieces):
            raise StructureError(f"truncated: it ends after {len(data)} bytes")
        if pieces and len(fields[offsets]) == len(fields[counts]):
            return
    raise StructureError("damaged: a TIFF page without a picture")
