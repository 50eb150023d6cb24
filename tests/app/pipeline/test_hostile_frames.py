"""A frame that harms its decoder costs itself alone: the flight goes on, and what happened is said."""

import os
import signal
from contextlib import closing
from pathlib import Path

import cv2
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.app.commands.batch import prefetching
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Notice
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.records import FrameState
from tests.frames.image_files import cut, encoded, many_scans, textured

pytestmark = pytest.mark.long

CONFIG = Config(decode=DecodeSettings(cpu_s=0.5))
SLOW = many_scans(encoded(".jpg", textured(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1), 6000)


@pytest.fixture
def folder(tmp_path: Path, ground: Image) -> Path:
    """Two frames of one place, a hostile one and a damaged one between them."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, x in ((1, 500), (4, 620)):
        cv2.imwrite(str(folder / f"{number}.jpg"), photograph(ground, Pose(x, 600, 0.0, 0.02), SMALL_CAMERA))
    (folder / "2.jpg").write_bytes(SLOW)
    (folder / "3.jpg").write_bytes(cut((folder / "1.jpg").read_bytes(), 0.6))
    return folder


def test_the_frames_behind_a_hostile_one_are_placed(folder: Path, tmp_path: Path) -> None:
    said = list[Notice]()
    (tmp_path / "out").mkdir()
    with closing(Pipeline(tmp_path / "out", CONFIG, said.append)) as pipeline:
        driver = Driver(pipeline)
        with closing(prefetching(pipeline, CONFIG)) as preparation:
            for frame in frames_in(folder).frames:
                accepted = driver.accept(frame)
                assert accepted is not None
                preparation.append(accepted)
            process = pipeline.decoders._desks[-1]._process
            assert process is not None
            os.kill(process.pid, signal.SIGKILL)
            done = {}
            while (prepared := preparation.next()) is not None:
                found = driver.process(prepared)
                done[found.name] = found
        image = pipeline.load_original("1.jpg")
        assert image is not None
        states = {frame.name: frame.state for frame in pipeline.store.ledger.frames()}
    assert states == {
        "1.jpg": FrameState.PLACED,
        "2.jpg": FrameState.DAMAGED,
        "3.jpg": FrameState.DAMAGED,
        "4.jpg": FrameState.PLACED,
    }
    assert done["2.jpg"].reason == "needs more than 0.5 s of computing time: damaged, or made to harm"
    assert "the JPEG's data end before the picture does" in (done["3.jpg"].reason or "")
    ended = [notice for notice in said if notice.source == "decoding"]
    assert [(notice.text, notice.level) for notice in ended] == [
        ("a process that decodes frames has ended (SIGKILL); it is started again", "warning")
    ]
