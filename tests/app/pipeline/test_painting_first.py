"""Live, a new frame is on the map before the map is adjusted to it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import cv2
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.stitch.camera.geometry import Pose
from tests.settings import FEW_FEATURES
from tests.sure import sure

pytestmark = pytest.mark.long

CONFIG = FEW_FEATURES


@pytest.fixture
def frames(tmp_path: Path, ground: Image) -> list[Frame]:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, x in enumerate((400, 500, 600)):
        cv2.imwrite(str(folder / f"{number}.jpg"), photograph(ground, Pose(x, 600, 0.0, 0.02), SMALL_CAMERA))
    return [frame for frame in frames_in(folder).frames if isinstance(frame, Frame)]


def note_calls(monkeypatch: pytest.MonkeyPatch, of: object, name: str, calls: list[str]) -> None:
    function = getattr(of, name)

    def noted(*given: object, **named: object) -> object:
        calls.append(name)
        return function(*given, **named)

    monkeypatch.setattr(of, name, noted)


def fail(*_: object) -> None:
    raise ArithmeticError("no inverse")


@contextmanager
def placed(out: Path, frames: list[Frame], said: list[Notice]) -> Iterator[Pipeline]:
    """Frames placed and painted, the map not adjusted to them yet."""
    out.mkdir()
    with closing(Pipeline(out, CONFIG, said.append, paint_first=True)) as pipeline:
        for frame in frames:
            Driver(pipeline).process(prepare(sure(pipeline.accept(frame)), pipeline.features_of))
        yield pipeline


@pytest.mark.parametrize("first", [True, False])
def test_tiles_are_written_before_the_adjustment_moves_what_they_show(
    first: bool, tmp_path: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    done = list[str]()
    (tmp_path / "out").mkdir()
    with closing(Pipeline(tmp_path / "out", CONFIG, lambda notice: None, paint_first=first)) as pipeline:
        note_calls(monkeypatch, pipeline.mosaic, "adjust", done)
        note_calls(monkeypatch, pipeline.store, "save", done)
        for frame in frames:
            Driver(pipeline).process(prepare(sure(pipeline.accept(frame)), pipeline.features_of))
            pipeline.adjust()
    once = ["save", "adjust"] if first else ["adjust", "save", "adjust"]
    assert done == once * 3


def test_what_the_adjustment_moves_is_painted_anew_and_its_failure_said(
    tmp_path: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = list[Notice]()
    with placed(tmp_path / "out", frames, said) as pipeline:
        before = {one.name: one.pose for one in pipeline.mosaic.placements()}
        pipeline.adjust()
        moved = {one.name: one.pose for one in pipeline.mosaic.placements()}
        assert moved != before
        assert pipeline.has_repaints

        monkeypatch.setattr(pipeline.mosaic, "adjust", fail)
        pipeline.adjust()
    assert ["the map could not be adjusted" in one.text for one in said] == [True]


def test_what_moved_while_it_could_not_be_noted_is_noted_later(
    tmp_path: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = list[Notice]()
    with placed(tmp_path / "out", frames, said) as pipeline:
        with monkeypatch.context() as patch:
            patch.setattr(pipeline.store, "note_placed", fail)
            pipeline.adjust()
        assert ["could not be noted" in one.text for one in said] == [True]
        assert {one.name for one in pipeline.mosaic.moved()} >= {frame.name for frame in frames[1:]}
