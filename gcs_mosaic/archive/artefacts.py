"""Artefacts: what tasks make, each under its key, whole or not there at all.

An artefact has named parts that can be read by themselves. It begins with the length and the digest of each, so that what was cut
off, or changed on the disk, counts as lost; and so does another artefact under its key.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from gcs_mosaic.store.checkpoint import decoded, encoded

MAGIC = b"gcs-mosaic artefact 2\n"
HEAD = struct.Struct("<I16s")  # length and digest of the table of parts
AHEAD = 4096  # bytes read at once: of most artefacts the table and the summary

MOST_BYTES = 1 << 30  # of a part as it is without compression
SAMPLED, WORTH = (
    65_536,
    0.6,
)  # bytes by which is judged whether compression is worth its time, and to what share of them
# By part: where it begins, its length, its digest, and whether it is compressed.
Table = dict[str, tuple[int, int, bytes, bool]]


class Lost(Exception):  # noqa: N818 - names a state
    """An artefact is not there, or not whole; `key`: which."""

    def __init__(self, key: str) -> None:
        super().__init__(key)
        self.key = key


@dataclass(frozen=True, slots=True)
class ListedFile:
    """A file as a listing has it; `tag` changes with its content where a store has such."""

    name: str
    size: int
    modified_ns: int
    tag: str = ""


class Files(Protocol):
    """Where artefacts lie: bytes by name. Raises CannotWrite if it cannot be reached or written."""

    def write(self, name: str, data: bytes) -> None:
        """Write a whole file, or nothing."""

    def read(self, name: str, start: int = 0, length: int | None = None) -> bytes | None:
        """A file or a part of it, shorter at the end of the file; None if there is no such file."""

    def size(self, name: str) -> int | None:
        """Bytes of a file; None if there is none."""

    def listed(self, under: str) -> Iterator[ListedFile]:
        """All files in a folder and below, with the folder's name, in any order."""

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""


class Artefacts:
    """Artefacts in some files."""

    def __init__(self, files: Files) -> None:
        self.files = files

    def put(self, key: str, parts: Mapping[str, object]) -> None:
        """Write an artefact whole. Raises CannotWrite."""
        at, table, data = 0, Table(), list[bytes]()
        for name, value in parts.items():
            part, is_packed = _packed(encoded(value))
            table[name] = at, len(part), _digest(part), is_packed
            at += len(part)
            data.append(part)
        head = encoded(table)
        self.files.write(key, b"".join([MAGIC, HEAD.pack(len(head), _digest(head, key)), head, *data]))

    def part(self, key: str, name: str) -> Any:
        """A part of an artefact. Raises Lost, also if anything of it is damaged."""
        first = self.files.read(key, 0, AHEAD)
        if first is None:
            raise Lost(key)
        try:
            table, start = self._table(key, first)
            at, length, digest, is_packed = table[name]
            data = first[start + at : start + at + length]
            if len(data) < length:
                data = self.files.read(key, start + at, length) or b""
            if _digest(data) == digest:
                return decoded(unpacked(data, MOST_BYTES) if is_packed else data)
        except Exception as error:  # what is damaged may raise anything
            raise Lost(key) from error
        raise Lost(key)

    def whole(self, key: str, name: str) -> Any:
        """A part, of an artefact that is as long as it should be: a sign that nothing of it was cut off. Raises Lost."""
        found = self.part(key, name)
        table, start = self._table(key, self.files.read(key, 0, AHEAD) or b"")
        if self.files.size(key) != start + sum(length for _, length, *_ in table.values()):
            raise Lost(key)
        return found

    def _table(self, key: str, first: bytes) -> tuple[Table, int]:
        """The table of parts, and where they begin. ValueError if it is damaged."""
        begin = len(MAGIC) + HEAD.size
        if not first.startswith(MAGIC) or len(first) < begin:
            raise ValueError("no artefact")
        length, digest = HEAD.unpack(first[len(MAGIC) : begin])
        head = first[begin : begin + length]
        if len(head) < length:
            head = self.files.read(key, begin, length) or b""
        if _digest(head, key) != digest:
            raise ValueError("a damaged table")
        return decoded(head), begin + length


def unpacked(data: bytes, most: int) -> bytes:
    """What `zlib.compress` has made small. Raises ValueError if it is damaged, or more than `most` bytes."""
    unpacking = zlib.decompressobj()
    try:
        whole = unpacking.decompress(data, most + 1)
    except zlib.error as error:
        raise ValueError(f"it is damaged ({error})") from error
    if not unpacking.eof or len(whole) > most:
        raise ValueError(f"it is cut off, or has more than {most} bytes")
    return whole


def _packed(data: bytes) -> tuple[bytes, bool]:
    """The bytes, compressed if that is worth it; and whether they are."""
    if len(data) < SAMPLED or len(zlib.compress(data[-SAMPLED:], 1)) > WORTH * SAMPLED:
        return data, False
    return zlib.compress(data, 1), True


def _digest(data: bytes, key: str = "") -> bytes:
    return hashlib.blake2b(key.encode() + data, digest_size=16).digest()
