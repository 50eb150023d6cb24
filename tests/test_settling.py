"""However little time there is at the end of a flight, every frame is settled and the map is adjusted."""

import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from stitch_ground import SMALL_CAMERA, photograph, textured_ground

from gcs_mosaic.app.inputs.links import Links
from gcs_mosaic.app.live import daemon
from gcs_mosaic.app.live.flight_page import FlightPage
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import OpenedFlight, open_flight
from gcs_mosaic.app.waiting.prefetch import DecodedFrame
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.video.watched import Room
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.mavlink.tlog_writer import Recording
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import Notice
from gcs_mosaic.stitch.bundle.schedule import Upkeep, UpkeepSettings
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.mosaic import Mosaic
from tests.frame_files import decoded

pytestmark = pytest.mark.long


SELDOM = UpkeepSettings(per_doubling=1)  # so that something is left to adjust at the end
CONFIG = Config(scale=1, stitch=replace(Config().stitch, upkeep=SELDOM))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> list[DecodedFrame]:
    """Three frames that overlap, and five of five other places, which are compared with them at the end."""
    folder, found = tmp_path_factory.mktemp("frames"), []
    for k, (seed, x) in enumerate([(1, 300), (1, 420), (1, 540), (2, 400), (3, 400), (4, 400), (5, 400), (6, 400)]):
        ground = np.dstack([textured_ground(900, seed)] * 3)
        found.append(decoded(folder / f"{k}.png", photograph(ground, Pose(x, 400), SMALL_CAMERA)))
    return found


def upkeep_of(pipeline: Pipeline) -> Upkeep:
    assert isinstance(pipeline.mosaic, Mosaic)
    return pipeline.mosaic._upkeep


def process(pipeline: Pipeline, flight: list[DecodedFrame]) -> None:
    for prepared in flight:
        pipeline.accept(prepared.frame)
        pipeline.process(prepared)
        pipeline.save()
    assert pipeline.accounts().frames.waiting == 5
    assert upkeep_of(pipeline)._grown


def assert_settled(pipeline: Pipeline) -> None:
    assert not upkeep_of(pipeline)._grown
    assert upkeep_of(pipeline)._task is None
    frames = pipeline.accounts().frames
    assert (frames.placed, frames.rejected, frames.waiting) == (3, 5, 0)


def test_a_flight_without_time_to_connect_is_settled_at_the_first_step(
    flight: list[DecodedFrame], tmp_path: Path
) -> None:
    said: list[Notice] = []
    with closing(Pipeline(tmp_path, CONFIG, said.append, punctual=True)) as pipeline:
        process(pipeline, flight)
        next(pipeline.settle(lambda: False))
        pipeline.save()
        assert_settled(pipeline)
    assert [notice.text for notice in said if "no time to connect" in notice.text]


def _parts_of(config: Config, opened: OpenedFlight) -> daemon._Parts:
    """A flight without links, frame sources and page."""
    links = Links((), Recording(), (), VehicleChoice(), Trust(), 0.0)
    return daemon._Parts(config, opened, links, (), FlightPage(config, None, opened.folder.path), Room())


@pytest.mark.parametrize("hurry", [True, False])
def test_a_flight_that_is_ended_without_time_is_settled(
    flight: list[DecodedFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hurry: bool
) -> None:
    """Asked to end at once, or after all the time at the end went into the last frames."""
    ending = Shutdown(stop=threading.Event(), hurry=threading.Event())
    config = replace(CONFIG, finish_s=30.0 if hurry else 0.0, out=str(tmp_path / "out"))
    with (
        closing(open_flight(config)) as opened,
        closing(daemon._Daemon(_parts_of(config, opened), Console(quiet=True), ending)) as flown,
    ):
        process(flown._pipeline, flight)
        monkeypatch.setattr(flown._pipeline._render_stage, "repaint_all", lambda placements: pytest.fail("no time"))
        ending.stop.set()
        if hurry:
            ending.hurry.set()
        flown._finish()
        assert_settled(flown._pipeline)
        assert Path(opened.folder.path / "mosaic.json").exists()
