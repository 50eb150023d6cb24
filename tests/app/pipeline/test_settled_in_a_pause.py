"""In a long pause the whole map is shown as at the end, so that the end has little left to do."""

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
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

BRIGHTER = (1.0, 1.12, 1.02, 1.25, 0.9)  # taken so in succession


@pytest.fixture
def frames(tmp_path: Path, ground: Image) -> list[Frame]:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, factor in enumerate(BRIGHTER):
        taken = photograph(ground, Pose(400 + 60 * number, 600, 0.0, 0.02), SMALL_CAMERA)
        lit = np.clip(taken * (0.75 * factor), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{number}.png"), lit)
    return [frame for frame in frames_in(folder).frames if isinstance(frame, Frame)]


def in_a_pause(pipeline: Pipeline) -> None:
    while pipeline.adjust_in_a_pause() or pipeline.repaint_some():
        pass
    pipeline.save()


def tiles(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in (out / "tiles").rglob("*.*") if path.is_file()}


@pytest.mark.parametrize("settled", [True, False])
def test_the_end_changes_no_tile_of_a_map_that_was_settled_in_a_pause(
    settled: bool, tmp_path: Path, frames: list[Frame]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with closing(Pipeline(out, FEW_FEATURES, lambda notice: None, paint_first=True)) as pipeline:
        driver = Driver(pipeline)
        for frame in frames:
            driver.process(prepare(sure(pipeline.accept(frame)), pipeline.features_of))
            pipeline.adjust()
        in_a_pause(pipeline)
        flown = tiles(out)
        if settled:
            pipeline.settle_in_a_pause()
            assert pipeline.has_repaints
            in_a_pause(pipeline)
            assert not pipeline.has_repaints
        before = tiles(out)
        assert (before != flown) == settled
        for _ in driver.finish():
            pass
        assert (tiles(out) == before) == settled


def test_frames_that_come_after_it_are_painted_on_it(tmp_path: Path, frames: list[Frame]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with closing(Pipeline(out, FEW_FEATURES, lambda notice: None, paint_first=True)) as pipeline:
        driver = Driver(pipeline)
        for number, frame in enumerate(frames):
            done = driver.process(prepare(sure(pipeline.accept(frame)), pipeline.features_of))
            pipeline.adjust()
            assert done.state.value == "placed"
            if number == 2:
                in_a_pause(pipeline)
                pipeline.settle_in_a_pause()
                pipeline.repaint_some()  # and no more: the next one has come
                pipeline.save()
        for _ in driver.finish():
            pass
        assert pipeline.accounts().frames.placed == len(frames)
        assert not pipeline.has_repaints


def test_what_fails_in_it_ends_no_flight(tmp_path: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    said = list[Notice]()
    out = tmp_path / "out"
    out.mkdir()
    with closing(Pipeline(out, FEW_FEATURES, said.append, paint_first=True)) as pipeline:
        Driver(pipeline).process(prepare(sure(pipeline.accept(frames[0])), pipeline.features_of))

        def fail() -> None:
            raise MemoryError

        monkeypatch.setattr(pipeline.mosaic, "placements", fail)
        pipeline.settle_in_a_pause()
    assert ["could not be painted in a pause" in one.text for one in said] == [True]
