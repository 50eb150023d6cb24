"""The input that an ONNX file declares, read from its protobuf messages: OpenCV runs a model with inputs that do not fit it, too.

Field numbers are those of onnx.proto: ModelProto.graph, GraphProto.initializer and .input, and so on down to the sizes.
"""

from __future__ import annotations

from gcs_mosaic.stitch.features.protobuf import every, fields, last

GRAPH, INITIALIZER, INITIALIZER_NAME, INPUT = 7, 5, 8, 11
NAME, TYPE, TENSOR, SHAPE, DIMENSION, SIZE = 1, 2, 1, 2, 1, 1

Shape = tuple[int | None, ...]


def declared_inputs(model: bytes) -> list[Shape]:
    """Shapes of the inputs of a model, None where a size is free. Raises ValueError if that is no protobuf message."""
    graph = last(memoryview(model), GRAPH)
    constant = {bytes(last(one, INITIALIZER_NAME)) for one in every(graph, INITIALIZER)}
    return [_shape(one) for one in every(graph, INPUT) if bytes(last(one, NAME)) not in constant]


def fits(declared: Shape, wanted: tuple[int, ...]) -> bool:
    """Whether a model that declares this shape takes arrays of the other one."""
    return len(declared) == len(wanted) and all(a in (None, b) for a, b in zip(declared, wanted, strict=True))


def _shape(value: memoryview) -> Shape:
    shape = last(last(last(value, TYPE), TENSOR), SHAPE)
    return tuple(_size(one) for one in every(shape, DIMENSION))


def _size(dimension: memoryview) -> int | None:
    """None: a name in place of a number, or nothing."""
    sizes = [value for number, value in fields(dimension) if number == SIZE and isinstance(value, int)]
    return sizes[-1] if sizes and 0 < sizes[-1] < 1 << 31 else None
