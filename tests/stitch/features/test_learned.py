"""Learned features, of a toy model: a keypoint is what is bright enough, a descriptor a few sums over its cell."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.cli import choices, options
from gcs_mosaic.config import model_trial
from gcs_mosaic.config.model_trial import try_model
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract, model_digest
from gcs_mosaic.stitch.features.learned import INPUT, LearnedDetector, UnusableModel, read_detector
from gcs_mosaic.stitch.features.matching import match

onnx = pytest.importorskip("onnx")

GAIN, NONE = 20.0, 10.0  # logit of a white pixel, and of "no keypoint"
LENGTH = 8
ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _of_this_clone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that tries a model imports what is tested here."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def toy(path: Path, *parts: str, shape: tuple[int, ...] = INPUT, least: float = 0.0) -> Path:
    """A model with these outputs, all if none are named; `least`: added to its descriptors."""
    from onnx import TensorProto, helper, numpy_helper

    pixels = np.vstack([np.eye(64) * GAIN, np.zeros((1, 64))]).reshape(65, 1, 8, 8)
    weights = {
        "keypoints": (pixels, np.array([0.0] * 64 + [NONE])),
        "descriptors": (np.random.default_rng(1).normal(size=(LENGTH, 1, 8, 8)), np.full(LENGTH, 0.1 + least)),
        "reliability": (np.zeros((1, 1, 8, 8)), np.ones(1)),
    }
    channels = shape[1]
    nodes, constants = [], []
    for part in parts or tuple(weights):
        kernel, bias = weights[part]
        values = {f"{part} kernel": np.repeat(kernel, channels, axis=1) / channels, f"{part} bias": bias}
        constants += [numpy_helper.from_array(value.astype(np.float32), name) for name, value in values.items()]
        nodes.append(helper.make_node("Conv", ["grey", *values], [part], kernel_shape=[8, 8], strides=[8, 8]))
    given = helper.make_tensor_value_info("grey", TensorProto.FLOAT, shape)
    told = [
        helper.make_tensor_value_info(part, TensorProto.FLOAT, (1, len(weights[part][1]), 60, 80))
        for part in parts or tuple(weights)
    ]
    graph = helper.make_graph(nodes, "toy", [given], told, constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    return path


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> LearnedDetector:
    return read_detector(toy(tmp_path_factory.mktemp("model") / "toy.onnx"))


def spots(width: int, height: int, *places: tuple[int, int], side: int = 1) -> NDArray[np.uint8]:
    """A black picture with white squares, of which these are the left upper pixels."""
    picture = np.zeros((height, width), np.uint8)
    for x, y in places:
        picture[y : y + side, x : x + side] = 255
    return picture


PLACES = ((96, 40), (200, 104), (280, 184))


@pytest.mark.parametrize("size", [(640, 480), (640, 352), (300, 480), (500, 333)])
def test_a_pixel_is_found_where_it_is(detector: LearnedDetector, size: tuple[int, int]) -> None:
    """Pixels' middles are whole numbers; what fills the input up brings no points of its own."""
    picture = spots(*size, *PLACES)
    found = detector.find(picture, 100)
    assert len(found.points) == len(PLACES)
    exact = 0.02 if 480 in size or 640 in size else 0.5  # a picture of another size is interpolated
    assert np.abs(found.points[np.argsort(found.points[:, 0])] - PLACES).max() < exact


@pytest.mark.parametrize("size", [(1280, 960), (1280, 704), (600, 960)])
def test_the_middle_of_a_square_is_found_in_a_picture_of_twice_the_size(
    detector: LearnedDetector, size: tuple[int, int]
) -> None:
    found = detector.find(spots(*size, *PLACES, side=2), 100)
    assert np.allclose(found.points[np.argsort(found.points[:, 0])], np.array(PLACES) + 0.5, atol=0.02)


def test_a_place_between_two_pixels_is_told(detector: LearnedDetector) -> None:
    picture = spots(640, 480, (100, 200))
    picture[200, 101] = 254
    ((x, y),) = detector.find(picture, 10).points
    assert (x, y) == pytest.approx((100.5, 200), abs=0.05)


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (2000, 20)])
def test_odd_sizes_do(detector: LearnedDetector, size: tuple[int, int]) -> None:
    assert len(detector.find(np.full(size[::-1], 255, np.uint8), 10).points) <= 10


def test_the_strongest_come_first_and_no_more_than_wanted(detector: LearnedDetector) -> None:
    picture = spots(640, 480)
    for k, level in enumerate((140, 200, 120, 170, 160)):
        picture[100, 100 + 50 * k] = level
    assert [round(x) for x, _ in detector.find(picture, 10).points] == [150, 250, 300, 100, 200]
    assert [round(x) for x, _ in detector.find(picture, 2).points] == [150, 250]


def test_a_black_picture_and_the_border_have_none(detector: LearnedDetector) -> None:
    found = detector.find(spots(640, 480, (1, 100), (300, 477)), 10)
    assert found.points.shape == (0, 2)
    assert found.descriptors.shape == (0, LENGTH)


def test_descriptors_are_bytes_of_one_length_and_match(detector: LearnedDetector) -> None:
    rng = np.random.default_rng(3)
    ground = np.where(rng.random((480, 700)) < 0.01, 255, rng.integers(0, 60, (480, 700))).astype(np.uint8)
    a, b = (detector.find(np.ascontiguousarray(ground[:, x : x + 640]), 500) for x in (0, 32))
    assert a.descriptors.dtype == np.int8
    length = np.linalg.norm(a.descriptors.astype(float), axis=1)
    assert length == pytest.approx(np.full(len(length), 127), rel=0.03)
    pairs = match(a.descriptors, b.descriptors, 0.8)
    off = a.points[pairs[:, 0]] - b.points[pairs[:, 1]]
    assert len(pairs) > 100
    assert np.mean(np.abs(off - [32, 0]).max(axis=1) < 0.01) > 0.95


def test_the_same_is_found_each_time_and_in_any_thread(detector: LearnedDetector, tmp_path: Path) -> None:
    pictures = [np.random.default_rng(k).integers(0, 256, (300, 400), dtype=np.uint8) for k in range(4)]
    other = read_detector(toy(tmp_path / "toy.onnx"))
    assert (other.digest, other.length) == (detector.digest, LENGTH)
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda picture: detector.find(picture, 50), pictures * 3))
    for one, picture in zip(found, pictures * 3, strict=True):
        again = other.find(picture, 50)
        assert np.array_equal(one.points, again.points)
        assert np.array_equal(one.descriptors, again.descriptors)


def test_a_model_may_leave_its_size_open(detector: LearnedDetector, tmp_path: Path) -> None:
    free = read_detector(toy(tmp_path / "free.onnx", shape=(1, 1, 0, 0)))
    picture = spots(500, 333, *PLACES)
    assert np.array_equal(free.find(picture, 9).points, detector.find(picture, 9).points)


def test_a_model_may_tell_no_reliability(detector: LearnedDetector, tmp_path: Path) -> None:
    without = read_detector(toy(tmp_path / "two.onnx", "descriptors", "keypoints"))
    picture = spots(640, 480, *PLACES)
    assert np.array_equal(without.find(picture, 9).points, detector.find(picture, 9).points)


def bad_files(folder: Path) -> dict[str, Path]:
    """By what is said of them."""
    (folder / "text.onnx").write_bytes(b"nothing")
    (folder / "empty.onnx").touch()
    whole = toy(folder / "whole.onnx").read_bytes()
    (folder / "half.onnx").write_bytes(whole[: len(whole) // 2])
    (folder / "hole.onnx").write_bytes(whole.replace(b"Conv", b"Fold"))
    return {
        "absent.onnx cannot be read (No such file or directory)": folder / "absent.onnx",
        "text.onnx is no ONNX model (no protobuf message: a field of kind 6)": folder / "text.onnx",
        "empty.onnx takes nothing, wanted is (1, 1, 480, 640)": folder / "empty.onnx",
        "half.onnx is no ONNX model (a protobuf message is cut off)": folder / "half.onnx",
        "gives (1, 65, 60, 80), wanted are (1, d, 60, 80), (1, 65, 60, 80) and perhaps (1, 1, 60, 80)": toy(
            folder / "keypoints.onnx", "keypoints"
        ),
        "gives (1, 8, 60, 80), (1, 1, 60, 80), wanted are": toy(folder / "none.onnx", "descriptors", "reliability"),
        "takes (1, 3, 480, 640), wanted is (1, 1, 480, 640)": toy(folder / "rgb.onnx", shape=(1, 3, 480, 640)),
        "takes (1, 1, 480, 480), wanted is (1, 1, 480, 640)": toy(folder / "square.onnx", shape=(1, 1, 480, 480)),
        "gives numbers beyond 1,000,000, or none": toy(folder / "nan.onnx", least=np.nan),
        "hole.onnx is no ONNX model that OpenCV": folder / "hole.onnx",
    }


@pytest.mark.long
def test_a_file_that_cannot_be_used_is_refused_in_one_sentence_that_says_what_to_do(tmp_path: Path) -> None:
    for said, path in bad_files(tmp_path).items():
        with pytest.raises(UnusableModel) as here:
            read_detector(path)
        with pytest.raises(UsageError, match=r"^stitch: features: model: ") as tried:
            try_model(str(path))
        for error in (str(here.value), str(tried.value)):
            assert said in error
            assert "\n" not in error
            assert "or leave the setting `model` out" in error


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import os; os.abort()", "crashes OpenCV"),
        ("import time; time.sleep(60)", "takes more than 0.5 s for one picture"),
    ],
)
def test_a_file_that_crashes_or_holds_up_what_loads_it_costs_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, said: str
) -> None:
    monkeypatch.setattr(model_trial, "PROGRAM", (sys.executable, "-c", program))
    monkeypatch.setattr(model_trial, "LONGEST_S", 0.5)
    with pytest.raises(UsageError, match=said):
        try_model(str(toy(tmp_path / "toy.onnx")))


def test_it_is_tried_before_a_flight(tmp_path: Path) -> None:
    settings = tmp_path / "settings.yaml"
    settings.write_text(f"stitch: {{features: {{model: {toy(tmp_path / 'toy.onnx')}}}}}", encoding="utf-8")
    given = options.parse(["--config", str(settings)])
    assert choices.config_of(given).stitch.features.model == str(tmp_path / "toy.onnx")
    (tmp_path / "toy.onnx").unlink()
    with pytest.raises(UsageError, match=r"toy\.onnx cannot be read"):
        choices.config_of(given)


def test_without_a_file_nothing_is_tried_and_features_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_trial, "PROGRAM", ("no such program",))
    assert choices.config_of(options.parse([])) == Config()
    assert Config().stitch.features.model is None
    picture = np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)
    assert extract(picture, FeatureSettings()).learned is None


def test_a_model_adds_features_and_changes_none(tmp_path: Path) -> None:
    model = str(toy(tmp_path / "toy.onnx"))
    picture = np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)
    plain, beside = (extract(picture, FeatureSettings(model=one)) for one in (None, model))
    assert np.array_equal(plain.points, beside.points)
    assert np.array_equal(plain.descriptors, beside.descriptors)
    assert beside.learned is not None
    assert len(beside.learned) <= FeatureSettings().count


def test_a_model_whose_file_is_gone_costs_no_frame(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    settings = FeatureSettings(model=str(tmp_path / "gone.onnx"))
    picture = np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)
    found = [extract(picture, settings) for _ in range(2)]
    assert all(len(one) > 0 and one.learned is None for one in found)
    assert len(caplog.messages) == 1
    assert model_digest(settings) is None


def test_another_file_under_the_same_name_is_another_model(tmp_path: Path) -> None:
    settings = [FeatureSettings(model=str(tmp_path / f"{place}" / "toy.onnx")) for place in range(2)]
    for one in settings:
        Path(one.model or "").parent.mkdir()
        toy(Path(one.model or ""))
    toy(Path(settings[1].model or ""), "descriptors", "keypoints")
    digests = {model_digest(one) for one in settings}
    assert len(digests) == 2
    assert None not in digests
