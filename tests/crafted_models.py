"""ONNX files as somebody would make them who wants harm: each asks for more than a picture needs, or for other files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

MANY = 1 << 17  # a side: of so many numbers squared, 64 GB


def crafted(
    folder: Path, channels: int = 1, size: tuple[int, int] = (480, 640), secret: str = "/etc/passwd"
) -> dict[str, Path]:
    """Files by what is wrong with them; the input is that of a picture of so many channels and pixels."""
    from onnx import helper

    maker = _Maker(folder, (1, channels, *size))
    add = [helper.make_node("Add", ["in", "w"], ["out"])]
    filled = [helper.make_node("ConstantOfShape", ["s"], ["w"]), *add]
    tiled = [helper.make_node("Tile", ["in", "s"], ["w"]), helper.make_node("Add", ["w", "w"], ["out"])]
    larger = [helper.make_node("Resize", ["in", "", "", "s"], ["out"], mode="nearest")]
    padded = [helper.make_node("Pad", ["in", "s"], ["out"])]
    chain = [helper.make_node("Add", [f"x{n}" if n else "in"] * 2, [f"x{n + 1}"]) for n in range(20_000)]
    made = {
        "huge constant": maker.saved("filled", filled, [constant([1, channels, MANY, MANY])]),
        "negative constant": maker.saved("negative", filled, [constant([-5, 1 << 40])]),
        "huge tile": maker.saved("tiled", tiled, [constant([1, 1, 1 << 10, 1 << 10])]),
        "huge picture": maker.saved("larger", larger, [constant([1, channels, MANY, MANY])]),
        "huge padding": maker.saved("padded", padded, [constant([0, 0, MANY, MANY, 0, 0, MANY, MANY])]),
        "size without data": maker.saved("hollow", add, [of_size([MANY, MANY])]),
        "negative size": maker.saved("below", add, [of_size([-1, 4])]),
        "overflowing size": maker.saved("over", add, [of_size([1 << 40, 1 << 40])]),
        "data of another file": maker.saved("outside", add, [elsewhere(secret)]),
        "data above the folder": maker.saved("above", add, [elsewhere("../../../../../../" + secret)]),
        "data of a device": maker.saved("device", add, [elsewhere("/dev/zero")]),
        "a long chain": maker.saved("chain", chain, [], "x20000"),
        "a circle": maker.saved("circle", [helper.make_node("Add", ["in", "out"], ["out"])], []),
        "no such operator": maker.saved("unknown", [helper.make_node("Harm", ["in"], ["out"], domain="evil")], []),
    }
    whole = maker.saved("whole", [helper.make_node("Relu", ["in"], ["out"])], []).read_bytes()
    for name, data in {"cut": whole[:-9], "noise": whole[:20] + bytes(range(256)) * 9, "deep": nested(3_000)}.items():
        made[name] = folder / f"{name}.onnx"
        made[name].write_bytes(data)
    return made


@dataclass(frozen=True, slots=True)
class _Maker:
    folder: Path
    shape: tuple[int, ...]

    def saved(self, name: str, nodes: list[Any], constants: list[Any], output: str = "out") -> Path:
        from onnx import TensorProto, helper

        given = helper.make_tensor_value_info("in", TensorProto.FLOAT, self.shape)
        told = helper.make_tensor_value_info(output, TensorProto.FLOAT, self.shape)
        graph = helper.make_graph(nodes, "crafted", [given], [told], constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        path = self.folder / f"{name}.onnx"
        path.write_bytes(model.SerializeToString())
        return path


def constant(value: list[int], name: str = "s", kind: Any = np.int64) -> Any:
    from onnx import numpy_helper

    return numpy_helper.from_array(np.array(value, kind), name)


def elsewhere(location: str) -> Any:
    """A tensor whose data are in another file."""
    from onnx import TensorProto

    tensor = constant([1] * 4, "w", np.float32)
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=location)
    return tensor


def of_size(dims: list[int]) -> Any:
    """A tensor that claims to be larger than its data."""
    tensor = constant([1], "w", np.float32)
    del tensor.dims[:]
    tensor.dims.extend(dims)
    return tensor


def nested(depth: int) -> bytes:
    """A graph in an attribute of a node of a graph in an attribute ..."""
    inner = b""
    for _ in range(depth):
        inner = field(1, field(5, field(6, inner)))
    return field(7, inner)


def field(number: int, content: bytes) -> bytes:
    """A protobuf field that has a length."""
    length, rest = b"", len(content)
    while rest > 127:
        length, rest = length + bytes([rest & 127 | 128]), rest >> 7
    return bytes([number << 3 | 2]) + length + bytes([rest]) + content
