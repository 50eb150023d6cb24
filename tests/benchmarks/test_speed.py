"""What the benchmark of speed measures by, on a few small frames and on processes that are known."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from sitl.path import Plan
from tests.benchmarks.floors import floor_of
from tests.benchmarks.flown_live import FlownLive, fly, pictures_in
from tests.benchmarks.long_growth import costs_of_flight
from tests.benchmarks.processes import Watched
from tests.benchmarks.recorded_stages import Stage, stages_in
from tests.benchmarks.side_by_side import Failed, each
from tests.benchmarks.speed import ending, quantiles
from tests.benchmarks.speed_costs import Work, measured
from tests.benchmarks.timeline import COLOURS, LEFT, ROW, TOP, draw

pytestmark = pytest.mark.long


SIZE = (640, 480)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    route = Plan(frames=4, height=60)
    sitl.flight.make("survey", folder, SIZE, cache=world_cache, seed=3, world_size=2048, route=route)
    return folder


def test_the_floor_is_that_of_every_size(frames: Path, tmp_path: Path) -> None:
    flight = stitch([frames], tmp_path / "mosaic", Config(), Console(quiet=True))
    floor = floor_of(flight, Config(), most=2)
    assert 0 < floor.decode < 1
    assert 0 < floor.warp < 1
    assert 0 < floor.encode < 1
    assert floor.all == floor.decode + floor.warp + floor.encode


@pytest.mark.thorough
def test_each_stage_of_a_stitch_is_measured(frames: Path) -> None:
    ((_, costs),) = each(measured, [Work(tuple(pictures_in(frames)), 0.5)])
    assert not isinstance(costs, Failed)
    assert {"decode", "features", "place", "adjust", "paint", "repaint", "tiles", "documents"} <= costs.stages.keys()
    assert all(floors >= 0 for floors in costs.stages.values())
    assert costs.stages["features"] > 0
    assert sum(costs.stages.values()) < costs.cpu, "the whole command has its start besides"
    assert costs.floor_s > 0
    assert costs.wall > 0
    assert costs.resident_mb > 50


@pytest.mark.thorough
def test_a_live_flight_is_measured(frames: Path, tmp_path: Path) -> None:
    flown = fly(pictures_in(frames), 0.3, tmp_path, "log: {level: debug}\n", page=False)
    assert flown.done.keys() == flown.whole.keys() == {path.name for path in pictures_in(frames)}
    assert all(0 < seconds < 30 for seconds in flown.latencies)
    assert all(0 < late <= latency for late, latency in zip(flown.newest_late, flown.latencies, strict=True))
    assert flown.cpu_s > 0.1
    assert 50 < flown.largest_mb <= flown.resident_mb
    assert "final map" in next(ending(flown))
    stages = list(stages_in((flown.out / "flight.log").read_text().splitlines()))
    assert {"decode", "features", "place", "adjust", "paint", "tiles", "encode", "ledger", "documents"} <= {
        s.name for s in stages
    }
    assert all(stage.start <= stage.end for stage in stages)


def test_how_late_the_newest_is_counts_newer_ones() -> None:
    flown = FlownLive(Path(), whole={"a": 0.0, "b": 1.0, "c": 2.0}, done={"a": 9.0, "b": 5.0, "c": 3.0})
    assert flown.newest_late == [3.0, 2.0, 1.0]
    assert flown.latencies == [9.0, 4.0, 1.0]
    assert flown.seconds_a_frame == 3.0
    assert quantiles(flown.newest_late) == "p50 2.00 s, p95 2.90 s, max 3.00 s"


def test_every_frame_of_a_long_flight_costs_something(tmp_path: Path) -> None:
    costs = list(costs_of_flight(5, tmp_path))
    assert len(costs) == 5
    assert all(cost.frame > 0 for cost in costs)
    assert len(list((tmp_path / "mosaic" / "tiles").rglob("*.jpg"))) > 10


def test_a_process_and_its_children_are_watched() -> None:
    burn = "import time; held = bytearray(80_000_000); end = time.time() + 1.2\nwhile time.time() < end: pass"
    command = [sys.executable, "-c", f"import subprocess, sys; subprocess.run([sys.executable, '-c', {burn!r}])"]
    process = subprocess.Popen(command)
    with Watched(process.pid) as watched:
        process.wait()
    assert 0.1 < watched.cpu_s < 2.5
    assert watched.resident_mb > 80


def test_stages_lie_where_the_axes_say() -> None:
    stages = [
        Stage("decode", "a", "prepare_0", 0, 11.0, 12.0),
        Stage("place", "a", "MainThread", 1, 12.0, 15.0),
        Stage("place", "b", "MainThread", 1, 16.0, 20.0),
    ]
    picture = draw(["a", "b"], [10.0, 15.5], stages)
    lit = {
        number: np.flatnonzero((np.abs(picture[TOP + 8] - np.array(colour)) < 3).all(axis=1))
        for number, colour in enumerate(COLOURS)
    }
    second = (picture.shape[1] - LEFT - 20) / 10
    assert lit[0].min() == pytest.approx(LEFT + 2 * second, abs=3)
    assert lit[0].max() == pytest.approx(LEFT + 5 * second, abs=3)
    assert lit[1].min() == pytest.approx(LEFT + 6 * second, abs=3)
    assert (np.abs(picture[TOP + ROW + 8, round(LEFT + 1.2 * second)] - np.array(COLOURS[0])) < 3).all()
