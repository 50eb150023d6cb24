"""A flight with a hole, the mission over it, flown by the simulator: the hole is closed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.cli.main import main
from gcs_mosaic.config.tree import Config
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView
from sitl.flight import Flight, plan
from sitl.geometry import CameraState
from sitl.messages import position
from sitl.path import Plan
from sitl.score import islands_of, lay
from tests.documents import document_at
from tests.notes.written_pins import write_pins

SIZE, HEIGHT, WORLD = (400, 300), 60.0, 4096
QUIET = Console(quiet=True)
AROUND = ((-60.0, -60.0), (60.0, -60.0), (-60.0, 60.0), (60.0, 60.0))  # of the middle, metres


def write_pictures(flight: Flight, folder: Path, begin: str) -> None:
    folder.mkdir(exist_ok=True)
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        (folder / f"{begin}_{Path(name).name}").write_bytes(data)


def gaps_of(out: Path) -> list[float]:
    """The areas of the gaps on the largest island, in canvas units."""
    islands = document_at(out / "mosaic.json")["islands"]
    largest = max((one for one in islands if one["merged_into"] is None), key=lambda one: one["frames"])
    return [gap.area for gap in IslandCoverage(FlightView(out)).of(largest["id"])[1]]


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
def test_a_mission_that_is_flown_closes_the_gap(tmp_path: Path, world_cache: Path) -> None:
    looks = {"seed": 3, "cache": world_cache, "world_size": WORLD}
    whole = plan("survey", SIZE, route=Plan(frames=70, height=HEIGHT, forward=0.6), **looks)  # type: ignore[arg-type]
    kept = [k for k, one in enumerate(whole.states) if abs(one.x) > 0.7 * HEIGHT or abs(one.y) > 0.6 * HEIGHT]
    first = replace(whole, states=tuple(whole.states[k] for k in kept), names=tuple(whole.names[k] for k in kept))
    write_pictures(first, tmp_path / "frames", "A")
    out = stitch([tmp_path / "frames"], tmp_path / "out", Config(), QUIET)
    (hole, *_) = gaps_of(out)
    pin_down(out, first, tmp_path)
    file = tmp_path / "gaps.waypoints"
    words = ["--format", "mission-waypoints", "--height", str(HEIGHT), "--to", str(file)]
    assert main(["export", str(out), *words]) == 0
    again = plan("mission", SIZE, route=Plan(waypoints=file, height=HEIGHT), **looks)  # type: ignore[arg-type]
    assert len(again.states) < len(whole.states) / 2
    write_pictures(again, tmp_path / "frames", "B")
    both = stitch([tmp_path / "frames"], tmp_path / "both", Config(), QUIET)
    assert document_at(both / "mosaic.json")["frames"]["placed"] >= len(first.states)
    assert sum(gaps_of(both)) < hole / 50
