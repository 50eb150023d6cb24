"""The input that an ONNX file declares, read from its protobuf messages: OpenCV runs a model with inputs that do not fit it, too.

Field numbers are those of onnx.proto: ModelProto.graph, GraphProto.initializer and .input, and so on down to the sizes.
"""

from __future__ import annotations

from collections.abc import Iterator

GRAPH, INITIALIZER, INITIALIZER_NAME, INPUT = 7, 5, 8, 11
NAME, TYPE, TENSOR, SHAPE, DIMENSION, SIZE = 1, 2, 1, 2, 1, 1
MOST_BYTES = 10  # of a varint

Shape = tuple[int | None, ...]


def declared_inputs(model: bytes) -> list[Shape]:
    """Shapes of the inputs of a model, None where a size is free. Raises ValueError if that is no protobuf message."""
    graph = _last(memoryview(model), GRAPH)
    constant = {bytes(_last(one, INITIALIZER_NAME)) for one in _all(graph, INITIALIZER)}
    return [_shape(one) for one in _all(graph, INPUT) if bytes(_last(one, NAME)) not in constant]


def fits(declared: Shape, wanted: tuple[int, ...]) -> bool:
    """Whether a model that declares this shape takes arrays of the other one."""
    return len(declared) == len(wanted) and all(a in (None, b) for a, b in zip(declared, wanted, strict=True))


def _shape(value: memoryview) -> Shape:
    shape = _last(_last(_last(value, TYPE), TENSOR), SHAPE)
    return tuple(_size(one) for one in _all(shape, DIMENSION))


def _size(dimension: memoryview) -> int | None:
    """None: a name in place of a number, or nothing."""
    sizes = [value for number, value in _fields(dimension) if number == SIZE and isinstance(value, int)]
    return sizes[-1] if sizes and 0 < sizes[-1] < 1 << 31 else None


def _last(message: memoryview, number: int) -> memoryview:
    """A field that holds a message; nothing if it is not there."""
    found = _all(message, number)
    return found[-1] if found else message[:0]


def _all(message: memoryview, number: int) -> list[memoryview]:
    return [value for field, value in _fields(message) if field == number and isinstance(value, memoryview)]


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Numbers and values of a message's fields: integers and what has a length."""
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
