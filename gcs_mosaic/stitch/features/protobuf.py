"""Fields of a protobuf message, without its schema. Source: the encoding that protobuf.dev documents."""

from __future__ import annotations

from collections.abc import Iterator

MOST_BYTES = 10  # of a varint


def last(message: memoryview, number: int) -> memoryview:
    """A field that holds a message; nothing if it is not there. Raises ValueError."""
    found = every(message, number)
    return found[-1] if found else message[:0]


def every(message: memoryview, number: int) -> list[memoryview]:
    """All fields of a number that hold messages, texts or bytes. Raises ValueError."""
    return [value for field, value in fields(message) if field == number and isinstance(value, memoryview)]


def fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Numbers and values of a message's fields: integers and what has a length. Raises ValueError if it is none."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind, number = key & 7, key >> 3
        if kind == 0:
            value, at = _varint(message, at)
            yield number, value
            continue
        if kind == 2:
            length, at = _varint(message, at)
            yield number, message[at : at + length]
        elif kind in (1, 5):
            length = 8 if kind == 1 else 4
        else:
            raise ValueError(f"no protobuf message: a field of kind {kind}")
        at += length
        if at > len(message):
            raise ValueError("a protobuf message is cut off")


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """A number of variable length, and where it ends."""
    value = 0
    for k, byte in enumerate(message[at : at + MOST_BYTES]):
        value |= (byte & 127) << (7 * k)
        if byte < 128:
            return value, at + k + 1
    raise ValueError("a protobuf message is cut off")
