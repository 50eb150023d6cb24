"""Packages of others bring frame sources, detectors and exports; what is wrong with one is a sentence, and ends no flight."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import gcs_mosaic
from gcs_mosaic.app.inputs.extended_source import extension_frames
from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.extensions import load, names
from gcs_mosaic.hints.detector import ExtensionDetector, detector_of
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.store.folder import LEDGER_NAME
from tests import running

EXAMPLE = Path(__file__).parent / "examples" / "example_extension.py"
ENTRIES = """
[gcs_mosaic.frame_sources]
example-folder = example_extension:frames
broken-import = no_such_module:frames
no-function = example_extension:EXAMPLE_NUMBER
raises = example_broken:frames
no-pair = example_broken:numbers
no-bytes = example_broken:texts
exits = example_broken:leave
[gcs_mosaic.detectors]
example-bright = example_extension:BrightestSpot
raises = example_broken:Detector
no-boxes = example_broken:NoBoxes
not-made = example_broken:frames
[gcs_mosaic.exports]
example-csv = example_extension:write_csv
raises = example_broken:write
"""
BROKEN = """
def frames(address, stop):
    yield "one.jpg", b"data"
    raise RuntimeError("the camera\\nis gone")

def numbers(address, stop):
    yield 1

def leave(address, stop):
    raise SystemExit("no licence")

def texts(address, stop):
    yield "one.jpg", "data"

class Detector:
    def __init__(self, confidence):
        pass
    def find(self, picture):
        raise MemoryError("too large")

class NoBoxes(Detector):
    def find(self, picture):
        return [(0, 0, float("nan"), 1, 1, 0)]

def write(flight, target):
    raise KeyError("name")
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path, as a package that was installed there leaves it."""
    place = tmp_path / "site"
    metadata = place / "example_extension-1.2.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: example-extension\nVersion: 1.2\n")
    (metadata / "entry_points.txt").write_text(ENTRIES)
    (place / "example_extension.py").write_text(EXAMPLE.read_text() + "\nEXAMPLE_NUMBER = 3\n")
    (place / "example_broken.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(place)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(place), str(Path(__file__).parents[1])]))
    return place


@contextmanager
def flown(tmp_path: Path, pictures: list[bytes], *options: str) -> Iterator[running.Running]:
    camera = tmp_path / "camera"
    camera.mkdir()
    for number, data in enumerate(pictures[:3]):
        (camera / f"{number}.jpg").write_bytes(data)
    with running.flying(tmp_path / "home", *options) as flight:
        yield flight


@pytest.mark.long
def test_frames_of_an_extension_are_stitched_beside_the_folder(
    installed: Path, pictures: list[bytes], tmp_path: Path
) -> None:
    with flown(tmp_path, pictures, "--source", f"example-folder:{tmp_path / 'camera'}") as flight:
        flight.wait_for_frames(placed=3)
        flight.bring("more.jpg", pictures[3])
        flight.wait_for_frames(placed=4)
        assert flight.end() == 0
    assert set(running.frames_of(flight.out)) == {*(f"example-folder//{number}.jpg" for number in range(3)), "more.jpg"}
    assert "'example-folder' has no more frames" in flight.said


@pytest.mark.long
def test_a_source_that_breaks_does_not_end_the_flight(installed: Path, pictures: list[bytes], tmp_path: Path) -> None:
    with flown(tmp_path, pictures, "--source", "raises") as flight:
        running.until(lambda: "without it" in flight.said, "what broke is said")
        flight.take("one.jpg", pictures[0])
        flight.wait_for_frames(placed=1)
        assert flight.end(signal.SIGINT) == 0
    told = next(line for line in flight.said.splitlines() if "without it" in line)
    assert "the frame source 'raises' of example-extension 1.2 has failed (RuntimeError: the camera is gone)" in told
    assert "Traceback" not in flight.said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("absent", "no frame source 'absent' is installed (there are: broken-import, example-folder"),
        ("broken-import", "of example-extension 1.2 cannot be loaded (ModuleNotFoundError: No module named"),
        ("no-function", "cannot be used: example_extension:EXAMPLE_NUMBER is no function"),
        ("no-pair", "has failed (TypeError"),
        ("no-bytes", "has failed (TypeError: expected name and bytes, got str and str)"),
        ("exits", "has failed (SystemExit: no licence)"),
        ("example-folder:/nowhere/at/all", "has failed (FileNotFoundError"),
    ],
)
def test_what_is_wrong_with_a_source_is_a_sentence(installed: Path, name: str, said: str) -> None:
    (notice,) = extension_frames(name, {}, _never())
    assert isinstance(notice, Notice)
    assert notice.level == "error"
    assert said in notice.text
    assert "\n" not in notice.text


def test_a_frame_that_a_resumed_flight_has_does_not_come_twice(installed: Path, tmp_path: Path) -> None:
    folder = tmp_path / "camera"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(b"one")
    known: dict[str, str | None] = {}
    told, name = f"example-folder:{folder}", "example-folder//a.jpg"
    assert [one.name for one in extension_frames(told, known, _never()) if isinstance(one, Frame)] == [name]
    assert [one for one in extension_frames(told, known, _never()) if isinstance(one, Frame)] == []
    (folder / "a.jpg").write_bytes(b"two")
    assert [one.name for one in extension_frames(told, known, _never()) if isinstance(one, Frame)] == [f"{name}#2"]


def test_a_detector_of_an_extension_finds(installed: Path) -> None:
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[7, 11] = 204
    detector = detector_of(HintSettings(detector="example-bright"))
    assert isinstance(detector, ExtensionDetector)
    (found,) = detector.find(picture)
    assert (found.left, found.top, found.confidence) == (11, 7, 0.8)
    strict = detector_of(HintSettings(detector="example-bright", confidence=0.9))
    assert strict is not None
    assert strict.find(picture) == []


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("absent", "no detector 'absent' is installed (there are: example-bright, no-boxes"),
        ("raises", "the detector 'raises' of example-extension 1.2 has failed (MemoryError: too large)"),
        ("no-boxes", "has failed (ValueError: (0, 0, nan, 1, 1) is no box with a confidence)"),
        ("not-made", "cannot be made (TypeError"),
    ],
)
def test_what_is_wrong_with_a_detector_is_a_sentence(installed: Path, name: str, said: str) -> None:
    with pytest.raises(UsageError) as error:
        ExtensionDetector(name, 0.5).find(np.zeros((4, 4, 3), np.uint8))
    assert said in str(error.value)


def test_a_model_and_a_detector_are_one_too_many() -> None:
    with pytest.raises(ValueError, match="a model or a detector"):
        HintSettings(model="a.onnx", detector="b")


@pytest.mark.long
def test_an_extension_exports_a_flight(
    installed: Path, pictures: list[bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with gcs_mosaic.open_flight(tmp_path / "map") as flight:
        for number in range(2):
            flight.add(pictures[number], f"{number}.jpg")
    where, target = str(tmp_path / "map"), tmp_path / "map.csv"
    assert main(["export", where, "--format", "example-csv", "--to", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: 2 frames\n"
    assert [line.split(",")[0] for line in target.read_text().splitlines()] == ["name", "0.jpg", "1.jpg"]
    assert main(["export", where, "--format", "raises"]) == 1
    told = capsys.readouterr().err
    assert told == "gcs-mosaic: the export format 'raises' of example-extension 1.2 has failed (KeyError: 'name')\n"
    assert main(["export", where, "--format", "example-csv", "--zoom", "3"]) == 2
    assert "knows no --zoom" in capsys.readouterr().err
    assert main(["export", where, "--format", "example-csv", "--to", str(tmp_path / "map" / LEDGER_NAME)]) == 2
    assert main(["export", where, "--format", "jpg"]) == 2
    assert "example-csv" in capsys.readouterr().err


def test_nothing_is_loaded_that_nobody_asks_for(installed: Path) -> None:
    assert "example-csv" in names("exports")
    assert callable(load("exports", "example-csv"))
    with pytest.raises(UsageError, match="there are: example-csv, raises"):
        load("exports", "other")


def _never() -> threading.Event:
    return threading.Event()
