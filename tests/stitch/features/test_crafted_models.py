"""Models made for harm are refused in one sentence: before anything is loaded, or by a process that has limits."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from gcs_mosaic.config.model_trial import try_model
from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.detector import Detector
from gcs_mosaic.stitch.features import onnx_check
from gcs_mosaic.stitch.features.learned import REMEDY, LearnedDetector, UnusableModel, model_bytes
from gcs_mosaic.stitch.features.onnx_check import trouble_of
from tests.crafted_models import crafted
from tests.fresh import ROOT

pytest.importorskip("onnx")

NOT_LOADED = {
    "data of another file": "other files",
    "data above the folder": "other files",
    "data of a device": "other files",
    "a long chain": "more than 10000 operators",
    "deep": "graphs within graphs",
    "cut": "cut off",
    "noise": "no protobuf message",
}
TRIED = ("huge tile", "size without data", "negative size")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return crafted(tmp_path_factory.mktemp("crafted"))


def test_what_would_do_harm_is_not_even_loaded(models: dict[str, Path]) -> None:
    """OpenCV read any file that a model names, and crashed of a device that never ends."""
    for name, said in NOT_LOADED.items():
        began = time.process_time()
        with pytest.raises(UnusableModel, match=said) as caught:
            LearnedDetector(model_bytes(models[name]), models[name].name)
        assert "\n" not in str(caught.value)
        assert time.process_time() - began < 2.0


@pytest.mark.parametrize("name", TRIED)
def test_what_asks_for_more_than_there_is_fails_in_a_process_of_its_own(
    models: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    with pytest.raises(UsageError, match=r"^stitch: features: model: ") as caught:
        try_model(str(models[name]))
    assert "\n" not in str(caught.value)
    assert REMEDY in str(caught.value)


def test_a_path_that_is_no_file_or_a_file_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(UnusableModel, match="it is no file"):
            model_bytes(path)
    with pytest.raises(UnusableModel, match="cannot be read"):
        model_bytes(tmp_path)
    monkeypatch.setattr(onnx_check, "LARGEST_BYTES", 1 << 20)
    (tmp_path / "large").write_bytes(bytes((1 << 20) + 1))
    with pytest.raises(UnusableModel, match="more than 1 MB"):
        model_bytes(tmp_path / "large")


def test_a_detector_may_have_its_data_beside_it_and_nowhere_else(models: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    inside = crafted(folder, secret="weights.bin")["data of another file"].read_bytes()
    assert trouble_of(inside, folder) is None
    assert trouble_of(inside) == "keeps its numbers in other files"
    (folder / "weights.bin").symlink_to(tmp_path / "secret")
    assert trouble_of(inside, folder) == "keeps its numbers in a file outside its folder"
    assert trouble_of(models["huge tile"].read_bytes()) is None


def test_a_crafted_detector_is_refused_in_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    for name, path in crafted(tmp_path, channels=3, size=(64, 64)).items():
        if name.startswith("huge"):
            continue  # these ask for memory, of which the process that seeks hints has a limit
        with pytest.raises(UsageError, match=r"^hints: ") as caught:
            Detector(path, 0.5)
        assert "\n" not in str(caught.value), name
        assert len(str(caught.value)) < 600
