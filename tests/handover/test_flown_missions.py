"""A flight with a hole, the mission over it, flown by the simulator: the hole is closed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.cli.main import main
from gcs_mosaic.stitch.camera.geometry import similarity_between
from gcs_mosaic.views.coverage import Coverage, Gap, IslandCoverage
from gcs_mosaic.views.flight_view import FlightView, FrameTable
from sitl.flight import Flight, plan
from sitl.geometry import CameraState
from sitl.messages import position
from sitl.path import Plan
from sitl.score import islands_of, lay
from tests.documents import document_at
from tests.notes.written_pins import write_pins
from tests.settings import FEW_FEATURES
from tests.sure import sure

SIZE, HEIGHT, WORLD = (320, 240), 60.0, 4096
QUIET = Console(quiet=True)
AROUND = ((-50.0, -60.0), (50.0, -60.0), (-50.0, 60.0), (50.0, 60.0))  # of the middle, metres


def write_pictures(flight: Flight, folder: Path, begin: str) -> None:
    folder.mkdir(exist_ok=True)
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        (folder / f"{begin}_{Path(name).name}").write_bytes(data)


def coverage_of(out: Path) -> tuple[FrameTable, Coverage, list[Gap]]:
    """Of island 0, which all frames are on."""
    view = FlightView(out)
    seen = IslandCoverage(view).of(0)
    return view.table(), sure(seen.coverage), seen.gaps


def unseen_within(out: Path, before: FrameTable, hole: Gap) -> float:
    """The share of a hole that nobody has seen by now. `before`: the frames on the canvas that it was told on."""
    now, coverage, _ = coverage_of(out)
    places = {one.name: (one.pose.x, one.pose.y) for one in now.frames}
    old = np.array([(one.pose.x, one.pose.y) for one in before.frames])
    new = np.array([places[one.name] for one in before.frames])
    scale, angle, shift = similarity_between(old, new)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    grid = coverage.grid
    cells = (np.array(hole.outline) @ turn.T + shift - (grid.left, grid.top)) / grid.cell - 0.5
    inside = cv2.fillPoly(np.zeros(coverage.looks.shape, np.uint8), [np.rint(cells).astype(np.int32)], 1) > 0
    assert inside.sum() > 100
    return float((coverage.looks[inside] == 0).mean())


def pin_down(out: Path, flight: Flight, folder: Path) -> None:
    """Four pins where the ground is known."""
    target = folder / "placements.json"
    assert main(["export", str(out), "--format", "placements", "--to", str(target)]) == 0
    truth = flight.truth()
    named = replace(truth, frames=tuple(replace(one, name=f"A_{Path(one.name).name}") for one in truth.frames))
    ground_from_canvas = lay(islands_of(named, document_at_path(target))[0][0])[0].ground_from_canvas
    pins = []
    for x, y in AROUND:
        u, v, w = np.linalg.solve(ground_from_canvas, (x, y, 1.0))
        latitude, longitude, *_ = position(CameraState(time=0, x=x, y=y, height=0, yaw=0, pitch=0, roll=0))
        pins.append((float(u / w), float(v / w), longitude / 1e7, latitude / 1e7))
    write_pins(out, pins)


def document_at_path(path: Path) -> dict[str, object]:
    told: dict[str, object] = json.loads(path.read_text())
    return told


@pytest.mark.long
@pytest.mark.thorough
@pytest.mark.timeout(900)
def test_a_mission_that_is_flown_closes_the_gap(tmp_path: Path, world_cache: Path) -> None:
    looks = {"seed": 3, "cache": world_cache, "world_size": WORLD}
    whole = plan("survey", SIZE, route=Plan(frames=40, height=HEIGHT, forward=0.6), **looks)  # type: ignore[arg-type]
    kept = [k for k, one in enumerate(whole.states) if abs(one.x) > 0.7 * HEIGHT or abs(one.y) > 0.6 * HEIGHT]
    first = replace(whole, states=tuple(whole.states[k] for k in kept), names=tuple(whole.names[k] for k in kept))
    write_pictures(first, tmp_path / "frames", "A")
    out = stitch([tmp_path / "frames"], tmp_path / "out", FEW_FEATURES, QUIET)
    before, _, (hole, *_) = coverage_of(out)
    assert unseen_within(out, before, hole) == 1.0
    pin_down(out, first, tmp_path)
    file = tmp_path / "gaps.waypoints"
    words = ["--format", "mission-waypoints", "--height", str(HEIGHT), "--to", str(file)]
    assert main(["export", str(out), *words]) == 0
    again = plan("mission", SIZE, route=Plan(waypoints=file, height=HEIGHT), **looks)  # type: ignore[arg-type]
    assert len(again.states) < len(whole.states) / 2
    write_pictures(again, tmp_path / "frames", "B")
    both = stitch([tmp_path / "frames"], tmp_path / "both", FEW_FEATURES, QUIET)
    assert document_at(both / "mosaic.json")["frames"]["placed"] >= len(first.states)
    assert unseen_within(both, before, hole) == 0.0
