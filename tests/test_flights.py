"""Simulated flights against the real daemon: real MAVLink over UDP, real files, judged by the known truth."""

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.views.flight_view import FlightView
from sitl.messages import position
from sitl.score import Score, score
from sitl.truth import Truth, read
from tests.documents import document_at
from tests.ports import free_port

TIMEOUT_S = 240
SIZE = "800x600"


@dataclass(frozen=True)
class Flown:
    said: str
    out: Path
    score: Score
    mosaic: dict[str, Any]
    status: dict[str, Any]

    def closes(self, frames: int) -> bool:
        """Whether both accounts are complete and nothing is left open."""
        of_frames: dict[str, int] = self.mosaic["frames"]
        of_events: dict[str, int] = self.mosaic["events"]
        return sum(of_frames.values()) == frames and of_frames["pending"] == of_events["pending"] == 0


def fly(tmp_path: Path, *options: str) -> Flown:
    """Fly with `python -m sitl` and return what became of it."""
    out, truth = tmp_path / "mosaic", tmp_path / "truth.json"
    folders = ("--watch", str(tmp_path / "frames"), "--out", str(out), "--truth", str(truth))
    command = [sys.executable, "-m", "sitl", "--size", SIZE, "--no-http", "--speed", "10"]
    command += ["--port", str(free_port()), *folders, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "against the truth" in done.stdout, done.stdout + done.stderr
    placements = json.loads(out.with_name("mosaic-placements.json").read_text())
    documents = [document_at(out / name) for name in ("mosaic.json", "status.json")]
    return Flown(done.stdout + done.stderr, out, score(read(truth), placements), *documents)


def off_and_stated_m(out: Path, truth: Truth) -> tuple[float, float]:
    """How far off the map's coordinates of the ground in the frames' middles are, and what is stated at most."""
    (laid,) = anchors_of(FlightView(out)).values()
    assert laid.by == "positions"
    assert laid.anchor is not None
    placed = {
        frame["name"]: frame for frame in json.loads(out.with_name("mosaic-placements.json").read_text())["frames"]
    }
    off, stated = [], []
    for frame in truth.frames:
        x, y, w = np.array(placed[frame.name]["canvas_from_frame"]) @ (*truth.lens.centre, 1)
        east, south = frame.grid_ground[len(frame.grid_ground) // 2]
        latitude, longitude = (value / 1e7 for value in position(replace(frame.state, x=east, y=south))[:2])
        there, here = laid.anchor.plane.spots(
            np.array([laid.anchor.places(np.array([x / w, y / w])), [longitude, latitude]])
        )
        off.append(float(np.hypot(*(there - here))))
        stated.append(laid.anchor.error(x / w, y / w).major_m)
    return max(off), max(stated)


@pytest.mark.long
def test_a_level_survey_that_positions_lay_on_earth(tmp_path: Path) -> None:
    flown = fly(tmp_path, "--scenario", "survey", "--manner", "px4,camera", "--count", "24", "--anchor", "positions")
    assert flown.score.placed == 24
    assert flown.score.islands == 1
    assert flown.score.ortho_rmse < 0.5
    assert flown.score.pair_p95 < 0.5
    assert flown.closes(frames=24)
    assert flown.mosaic["events"]["matched"] == 24  # of the messages of three senders, the others are duplicates
    assert flown.mosaic["events"]["duplicate"] >= 24
    assert flown.status["state"] == "stopped"
    off_m, stated_m = off_and_stated_m(flown.out, read(tmp_path / "truth.json"))
    assert off_m < 2.0 < stated_m < 20.0


@pytest.mark.thorough
@pytest.mark.long
def test_a_climb_to_three_times_the_height(tmp_path: Path) -> None:
    flown = fly(tmp_path, "--scenario", "climb", "--manner", "ardupilot", "--count", "20")
    assert flown.score.placed == 20
    assert flown.score.islands == 1
    assert flown.score.ortho_rmse < 0.5
    assert 0.995 < flown.score.scale_p5 <= flown.score.scale_p95 < 1.005
    assert flown.closes(frames=20)
    levels = {int(path.name) for path in (flown.out / "tiles" / "0").iterdir()}
    island = flown.mosaic["islands"][0]
    assert levels == set(range(island["minzoom"], island["maxzoom"] + 1))


@pytest.mark.thorough
@pytest.mark.long
def test_lost_overlap_that_comes_back(tmp_path: Path) -> None:
    """What lies beyond a gap waits, or is an island, until the gap is flown; two frames of elsewhere never belong."""
    flown = fly(tmp_path, "--scenario", "lost", "--manner", "camera", "--count", "30", "--strangers", "2")
    frames = flown.mosaic["frames"]
    assert flown.score.placed == flown.score.frames - 2
    assert frames["rejected"] == 2
    assert flown.score.islands == 1
    assert flown.score.ortho_rmse < 0.5
    assert flown.closes(frames=flown.score.frames)


@pytest.mark.thorough
@pytest.mark.long
def test_frames_that_see_the_horizon(tmp_path: Path) -> None:
    """Oblique frames may be left out, but they spoil nothing, as long as they are stitched about in their order."""
    flown = fly(tmp_path, "--scenario", "oblique", "--manner", "px4", "--count", "30", "--speed", "2")
    assert flown.score.placed >= 28
    assert flown.score.ortho_worst_frame < 15
    assert flown.score.pair_p95 < 1
    assert flown.closes(frames=30)
    left, top, right, bottom = flown.mosaic["islands"][0]["bounds"]
    assert max(right - left, bottom - top) < 20 * 800


@pytest.mark.long
def test_a_line_that_looks_far_ahead_lies_on_the_true_plane(tmp_path: Path) -> None:
    """On the other plane, which two frames fit as well, frames lay hundreds of pixels off."""
    flown = fly(tmp_path, "--scenario", "ahead", "--manner", "px4", "--count", "10")
    assert flown.score.placed == flown.score.frames == 10
    assert flown.score.islands == 1
    assert flown.score.ortho_worst_frame < 5
    assert flown.closes(frames=10)


@pytest.mark.thorough
@pytest.mark.long
def test_ground_with_hills_houses_and_trees_and_a_bad_link(tmp_path: Path) -> None:
    faults = ("--drop", "0.1", "--duplicate", "0.1", "--reorder", "0.1")
    flown = fly(tmp_path, "--scenario", "survey", "--relief", "1", "--manner", "px4,camera", "--count", "20", *faults)
    assert flown.score.placed == 20
    assert flown.score.ortho_rmse < 15
    assert flown.closes(frames=20)
