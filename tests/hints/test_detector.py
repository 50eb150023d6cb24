"""A detector that the operator brings, here a toy: whatever is red enough is a thing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.detector import Detector

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

SIDE = 64


def toy(path: Path, shape: list[int | str], *, transposed: bool = False) -> Path:
    """A model of which each row of pixels is a box of one pixel, as sure as it is red: (1, n, 6) or (1, 4 + 1, n)."""
    from onnx import TensorProto, helper, numpy_helper

    rows, columns = np.mgrid[:SIDE, :SIDE].reshape(2, -1).astype(np.float32)
    if transposed:
        fixed = np.stack([columns + 0.5, rows + 0.5, np.ones_like(rows), np.ones_like(rows)])[None]
    else:
        fixed = np.stack([columns, rows, columns + 1, rows + 1], axis=1)[None]
    zeros = np.zeros((1, SIDE * SIDE, 1), np.float32)
    ints = {"start": [0], "stop": [1], "axis": [1], "flat": [1, 1, -1] if transposed else [1, -1, 1]}
    constants = [numpy_helper.from_array(np.array(value, np.int64), name) for name, value in ints.items()]
    constants += [numpy_helper.from_array(fixed, "fixed"), numpy_helper.from_array(zeros, "zeros")]
    parts = ["fixed", "red"] if transposed else ["fixed", "red", "zeros"]
    nodes = [
        helper.make_node("Slice", ["picture", "start", "stop", "axis"], ["plane"]),
        helper.make_node("Reshape", ["plane", "flat"], ["red"]),
        helper.make_node("Concat", parts, ["boxes"], axis=1 if transposed else 2),
    ]
    given = helper.make_tensor_value_info("picture", TensorProto.FLOAT, shape)
    told = helper.make_tensor_value_info("boxes", TensorProto.FLOAT, None)
    graph = helper.make_graph(nodes, "toy", [given], [told], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, str(path))
    return path


@pytest.mark.parametrize("transposed", [False, True])
def test_what_a_model_finds_is_told_in_pixels_of_the_whole_picture(tmp_path: Path, transposed: bool) -> None:
    detector = Detector(toy(tmp_path / "toy.onnx", [1, 3, SIDE, SIDE], transposed=transposed), 0.5)
    picture = np.zeros((100, 150, 3), np.uint8)
    picture[80, 120] = picture[5, 7] = (0, 0, 255)
    picture[50, 50] = (255, 255, 0)  # not red
    picture[40, 40] = (0, 0, 100)  # not red enough
    found = {(one.left, one.top, one.width, one.height, one.label) for one in detector.find(picture)}
    assert found == {(120, 80, 1, 1, 0), (7, 5, 1, 1, 0)}


def test_a_picture_smaller_than_the_model_is_searched_too(tmp_path: Path) -> None:
    detector = Detector(toy(tmp_path / "toy.onnx", [1, 3, SIDE, SIDE]), 0.5)
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[10, 20] = (0, 0, 255)
    assert [(one.left, one.top) for one in detector.find(picture)] == [(20, 10)]


def test_a_file_that_is_no_model_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "no.onnx").write_bytes(b"nothing")
    for path in ("no.onnx", "absent.onnx"):
        with pytest.raises(UsageError, match="no model"):
            Detector(tmp_path / path, 0.5)
    with pytest.raises(UsageError, match=r"wanted is \(1, 3, height, width\)"):
        Detector(toy(tmp_path / "grey.onnx", [1, 1, SIDE, SIDE]), 0.5)
