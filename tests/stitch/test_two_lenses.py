"""Two aircraft with cameras of one size and different lenses over one ground: each lens is found, and the map is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.frames.decode import Unreadable, load_image
from gcs_mosaic.stitch.features.extraction import extract
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.camera import Camera
from sitl.flight import Flight, make
from sitl.path import Plan

pytestmark = pytest.mark.long

SIZE, FRAMES = (480, 360), 12
# Climbs tell a focal length; that of the second is a quarter longer. Each is to be found nearer to its own than to the other's.
FOCALS, OWN = (1.2, 1.5), 0.05


def flown(folder: Path, cache: Path, focal: float) -> Flight:
    camera = Camera()
    camera = replace(camera, lens=replace(camera.lens, focal=focal))
    route = Plan(frames=FRAMES, height=60, climbs=1)
    return make("survey", folder, SIZE, cache=cache, seed=3, world_size=4096, camera=camera, route=route)


def focals_found(tmp_path: Path, cache: Path) -> tuple[int, list[float]]:
    """The number of islands, and each aircraft's focal length as its frames have it, in half-diagonals."""
    mosaic = Mosaic()
    for number, focal in enumerate(FOCALS):
        folder = tmp_path / str(number)
        for name in flown(folder, cache, focal).names:
            image = load_image(folder / name)
            assert not isinstance(image, Unreadable)
            features = extract(image, mosaic.settings.features)
            mosaic.place(features, f"{number}/{name}", aircraft=number)
            mosaic.adjust()
    while mosaic.connect_some():
        mosaic.adjust()
    mosaic.adjust(everything=True)
    placed = mosaic.placements()
    of_each = [[one.camera.focal for one in placed if one.name.startswith(f"{number}/")] for number in range(2)]
    return len(mosaic.frame_counts()), [float(np.median(focals)) for focals in of_each]


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="with heights of its points free the first lens, 3 % off over a plane, is drawn 7 % to an ordinary one",
)
@pytest.mark.thorough
def test_each_aircraft_has_its_lens(tmp_path: Path, world_cache: Path) -> None:
    islands, found = focals_found(tmp_path, world_cache)
    assert islands == 1
    assert abs(found[0] / FOCALS[0] - 1) < OWN
    assert abs(found[1] / FOCALS[1] - 1) < OWN
