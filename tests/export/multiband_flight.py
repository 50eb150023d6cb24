"""Small simulated flights of many and of deep bands, stitched; and what the ground has at any place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from rich.console import Console

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.cli.main import main
from sitl.camera import SHARPNESS, Camera
from sitl.flight import Flight
from sitl.path import Plan
from sitl.score import islands_of, lay
from sitl.sensor import Sensor
from tests.settings import FEW_FEATURES

QUIET = Console(quiet=True)
WINDOW = 384  # px of the map that are compared with the ground


class Flown(NamedTuple):
    flight: Flight
    out: Path
    placements: dict[str, Any]


def flown(
    tmp_path_factory: pytest.TempPathFactory, world_cache: Path, exposure_step: float = 1.0, **sensor: int
) -> Flown:
    """A small flight of a camera with hardly a fault, stitched."""
    folder = tmp_path_factory.mktemp("flight")
    camera = Camera(vignetting=0.0, noise=0.5, exposure_step=exposure_step, step_every=2, sensor=Sensor(**sensor))
    route = Plan(frames=8)
    flight = sitl.flight.make("survey", folder / "frames", (480, 360), cache=world_cache, route=route, camera=camera)
    out = stitch([folder / "frames" / "DCIM"], folder / "out", FEW_FEATURES, QUIET)
    assert main(["export", str(out), "--format", "placements", "--to", str(folder / "placements.json")]) == 0
    return Flown(flight, out, json.loads((folder / "placements.json").read_text()))


def ground_from_canvas(one: Flown) -> np.ndarray:
    """(3, 3) of the first frame's island: to metres east and south."""
    return lay(islands_of(one.flight.truth(), one.placements)[0][0])[0].ground_from_canvas


def finest_gsd(one: Flown) -> float:
    """Metres per canvas unit at the flight's height."""
    return one.flight.states[0].height / one.flight.scene.camera.lens.focal_px


def ground_counts(one: Flown, ground: np.ndarray, gsd: float) -> np.ndarray:
    """(h, w, bands) that the camera reads where the ground is seen at places (h, w, 2), m east and south, at `gsd` m/px."""
    scene = one.flight.scene
    octave = np.log2(gsd / scene.world.gsd) - SHARPNESS
    x, y = np.moveaxis(ground, -1, 0)
    sensor = scene.camera.sensor
    return sensor.counts(sensor.levels(scene.world.colours(x, y, np.full(x.shape, octave, np.float32))))


def middle(image: np.ndarray, side: int = WINDOW) -> tuple[slice, slice]:
    """Columns and rows of a window that is covered all over."""
    covered = cv2.erode((image[..., -1] == image[..., -1].max()).astype(np.uint8), np.ones((side, side)))
    y, x = (int(np.median(place)) for place in np.nonzero(covered))
    half = side // 2
    return slice(x - half, x + half), slice(y - half, y + half)
