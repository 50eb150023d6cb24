"""What makes an ONNX file one that is not even loaded: a library would read other files for it, or compute for ever.

And the input that it declares, because OpenCV runs a model with inputs that do not fit it, too. Field numbers are those of
onnx.proto: ModelProto.graph, GraphProto.initializer and .input, and so on down to the sizes.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.stitch.features.protobuf import every, fields, last

LARGEST_BYTES = 256 << 20  # learned features have some MB, detectors up to 150
MOST_NODES = 10_000  # detectors have some 3,000; of 20,000 in a row a library makes a plan for minutes
MOST_FIELDS = 1_000_000  # looked at
DEEPEST = 16  # graphs within graphs

# Fields that hold messages, by the kind of a message, and the kind of theirs.
_PARTS = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor", 11: "input", 15: "sparse"},
    "function": {7: "node"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
}
_EXTERNAL_DATA, _DATA_LOCATION = 13, 14  # of a tensor
_KEY, _VALUE = 1, 2  # of an entry of external data
_GRAPH, _INITIALIZER, _INITIALIZER_NAME, _INPUT = 7, 5, 8, 11
_NAME, _TYPE, _TENSOR, _SHAPE, _DIMENSION, _SIZE = 1, 2, 1, 2, 1, 1

Shape = tuple[int | None, ...]


def read_model(path: Path) -> bytes:
    """The bytes of a model's file. Raises ValueError, with a reason, for what is no file, or too large; and OSError."""
    with open(path, "rb", opener=_open_at_once) as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise ValueError("it is no file")
        if found.st_size > LARGEST_BYTES:
            raise ValueError(f"it has more than {LARGEST_BYTES >> 20} MB")
        return file.read(LARGEST_BYTES)


def trouble_of(model: bytes, folder: Path | None = None) -> str | None:
    """Why a model is not to be loaded; None if nothing is against it. `folder`: in which data may lie beside the model.

    Raises ValueError if that is no protobuf message.
    """
    walk = _Walk(folder)
    walk.enter(memoryview(model), "model", 0)
    return walk.trouble


@dataclass(slots=True)
class _Walk:
    """Through all messages that may hold a tensor; ends with the first trouble."""

    folder: Path | None
    nodes: int = 0
    looked_at: int = 0
    trouble: str | None = None

    def enter(self, message: memoryview, kind: str, depth: int) -> None:
        if depth > DEEPEST * 3:
            self.trouble = f"has graphs within graphs, more than {DEEPEST}"
        parts = _PARTS.get(kind, {})
        for number, value in fields(message):
            self.looked_at += 1
            if self.trouble is None and self.looked_at > MOST_FIELDS:
                self.trouble = f"has more than {MOST_FIELDS} parts"
            if self.trouble is not None:
                return
            if kind == "tensor":
                self._tensor(number, value)
            elif number in parts and isinstance(value, memoryview):
                self._count(parts[number])
                self.enter(value, parts[number], depth + 1)

    def _count(self, kind: str) -> None:
        self.nodes += kind == "node"
        if self.nodes > MOST_NODES:
            self.trouble = f"has more than {MOST_NODES} operators"

    def _tensor(self, number: int, value: int | memoryview) -> None:
        if number == _DATA_LOCATION and value and self.folder is None:
            self.trouble = "keeps its numbers in other files"
        elif number == _EXTERNAL_DATA and isinstance(value, memoryview):
            if self.folder is None:
                self.trouble = "keeps its numbers in other files"
            elif bytes(*every(value, _KEY)[-1:]) == b"location":
                self._locate(self.folder, bytes(*every(value, _VALUE)[-1:]).decode("utf-8", "replace"))

    def _locate(self, folder: Path, location: str) -> None:
        inside = "\0" not in location and (folder / location).resolve().is_relative_to(folder.resolve())
        if not inside:
            self.trouble = "keeps its numbers in a file outside its folder"


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # else opening a pipe without a writer would block


def declared_inputs(model: bytes) -> list[Shape]:
    """Shapes of the inputs of a model, None where a size is free. Raises ValueError if that is no protobuf message."""
    graph = last(memoryview(model), _GRAPH)
    constant = {bytes(last(one, _INITIALIZER_NAME)) for one in every(graph, _INITIALIZER)}
    return [_shape(one) for one in every(graph, _INPUT) if bytes(last(one, _NAME)) not in constant]


def fits(declared: Shape, wanted: tuple[int, ...]) -> bool:
    """Whether a model that declares this shape takes arrays of the other one."""
    return len(declared) == len(wanted) and all(a in (None, b) for a, b in zip(declared, wanted, strict=True))


def _shape(value: memoryview) -> Shape:
    shape = last(last(last(value, _TYPE), _TENSOR), _SHAPE)
    return tuple(_size(one) for one in every(shape, _DIMENSION))


def _size(dimension: memoryview) -> int | None:
    """None: a name in place of a number, or nothing."""
    sizes = [value for number, value in fields(dimension) if number == _SIZE and isinstance(value, int)]
    return sizes[-1] if sizes and 0 < sizes[-1] < 1 << 31 else None
