"""Layers and gaps of a simulated flight against what the simulator knows of it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.views.coverage import Coverage, Gap, IslandCoverage
from gcs_mosaic.views.flight_view import FlightView
from sitl.flight import Flight, make
from sitl.geometry import pixels_from_ground
from sitl.path import Plan
from sitl.similarity import robust_similarity
from tests.documents import document_at
from tests.running import run
from tests.sure import sure
from tests.tiers import THOROUGH

pytestmark = THOROUGH

ROUTE = Plan(frames=45, forward=0.7, side=0.3, height=60.0, tilt=0.15, wind=4.0)
MISSING = range(20, 23)  # frames, in the middle of a line
BLURRED, BLUR_PX = 10, 7
FIRST_UTC, EACH_S = 1.7e9, 2.0


@dataclass(frozen=True)
class Flown:
    flight: Flight
    out: Path

    @cached_property
    def there(self) -> list[int]:
        return [number for number in range(len(self.flight.states)) if number not in MISSING]

    @cached_property
    def seen(self) -> tuple[Coverage, list[Gap]]:
        seen = IslandCoverage(FlightView(self.out)).of(0)
        assert seen.coverage is not None
        return seen.coverage, seen.gaps

    @cached_property
    def metres(self) -> tuple[np.ndarray, float]:
        """Where the middles of the grid's cells lie on the ground (rows, columns, 2), and metres per canvas unit."""
        placements = document_at(self.out / "placements.json")["frames"]
        truth = {frame.name: frame for frame in self.flight.truth().frames}
        canvas, ground = [], []
        for one in placements:
            frame = truth[one["name"]]
            pixels = frame.grid_px[frame.grid_used]
            canvas.append(cv2.perspectiveTransform(pixels[None], np.array(one["canvas_from_frame"]))[0])
            ground.append(frame.grid_ground[frame.grid_used])
        ground_from_canvas = robust_similarity(np.concatenate(canvas), np.concatenate(ground))
        grid = self.seen[0].grid
        x = grid.left + (np.arange(grid.columns) + 0.5) * grid.cell
        y = grid.top + (np.arange(grid.rows) + 0.5) * grid.cell
        places = np.stack(np.meshgrid(x, y), axis=-1)
        spots = places @ ground_from_canvas[:2, :2].T + ground_from_canvas[:2, 2]
        return spots, float(np.hypot(*ground_from_canvas[:2, 0]))

    def inside(self, number: int, margin_px: float = 0.0) -> np.ndarray:
        """Which cells a frame truly sees."""
        lens, spots = self.flight.scene.camera.lens, self.metres[0]
        pixels = pixels_from_ground(lens, self.flight.states[number], spots.reshape(-1, 2)).reshape(spots.shape)
        low, high = margin_px - 0.5, np.array([lens.width, lens.height]) - 0.5 - margin_px
        return np.asarray(((pixels > low) & (pixels < high)).all(axis=-1))

    @cached_property
    def certain(self) -> np.ndarray:
        """Cells that lie on no frame's border, where a pixel more or less decides."""
        unsure = [self.inside(number, -9) & ~self.inside(number, 9) for number in self.there]
        return np.asarray(~np.any(unsure, axis=0))

    def of_each(self, values: list[float], nothing: float) -> np.ndarray:
        """For each cell (frames, rows, columns) the value of each frame that sees it, else `nothing`."""
        rows = zip(self.there, values, strict=True)
        return np.stack([np.where(self.inside(number), value, nothing) for number, value in rows])


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flown:
    home = tmp_path_factory.mktemp("layers")
    flight = make("survey", home / "pictures", (640, 480), route=ROUTE, cache=world_cache)
    for number, name in enumerate(flight.names):
        path = home / "pictures" / name
        if number == BLURRED:
            path.write_bytes(cv2.imencode(".jpg", cv2.blur(sure(cv2.imread(str(path))), (BLUR_PX, 1)))[1].tobytes())
        utc = FIRST_UTC + EACH_S * number
        os.utime(path, (utc, utc))
        if number in MISSING:
            path.unlink()
    done = run("stitch", home / "pictures", "--out", home / "map", cwd=home)
    assert done.returncode == 0, done.stderr
    found = Flown(flight, home / "map")
    assert len(document_at(found.out / "placements.json")["frames"]) == len(found.there)
    return found


def test_the_number_of_looks_is_the_true_one(flown: Flown) -> None:
    true = np.sum([flown.inside(number) for number in flown.there], axis=0)
    wrong = (flown.seen[0].looks != true) & flown.certain
    assert flown.certain.mean() > 0.4
    assert wrong.mean() < 0.002


def test_the_finest_resolution_is_the_true_one(flown: Flown) -> None:
    """That of a frame straight below the camera; what tilts make of it (2 % at 8 degrees) is told as the angle."""
    lens, metres = flown.flight.scene.camera.lens, flown.metres[1]
    below = [flown.flight.states[number].height / lens.focal_px for number in flown.there]
    true = flown.of_each(below, np.inf).min(axis=0)
    compared = flown.certain & np.isfinite(true)
    ratio = flown.seen[0].finest[compared] * metres / true[compared]
    assert np.abs(np.log(ratio)).max() < 0.01


def test_the_steepest_angle_is_the_true_one(flown: Flown) -> None:
    states = [flown.flight.states[number] for number in flown.there]
    tilts = [float(np.degrees(np.arccos(np.cos(state.pitch) * np.cos(state.roll)))) for state in states]
    true = flown.of_each(tilts, np.inf).min(axis=0)
    compared = flown.certain & np.isfinite(true)
    assert np.abs(flown.seen[0].steepest[compared] - true[compared]).max() < 1.0
    assert true[compared].max() > 3


def test_the_newest_look_is_the_true_one(flown: Flown) -> None:
    true = flown.of_each([FIRST_UTC + EACH_S * number for number in flown.there], -np.inf).max(axis=0)
    compared = flown.certain & np.isfinite(true)
    assert np.abs(flown.seen[0].newest[compared] - true[compared]).max() < 0.01


def test_where_only_a_blurred_frame_looked_the_map_says_so(flown: Flown) -> None:
    others = np.any([flown.inside(number) for number in flown.there if number != BLURRED], axis=0)
    alone = flown.inside(BLURRED) & ~others & flown.certain
    sharp = flown.seen[0].sharpest
    assert alone.any()
    assert sharp[alone].max() < 0.75
    assert np.nanquantile(sharp[others & flown.certain], 0.05) > 0.8


def test_the_stated_deviation_holds_on_flat_ground(flown: Flown) -> None:
    """A cell is as sure as the surest frame that saw it; frames lie within three of their own."""
    placements = document_at(flown.out / "placements.json")["frames"]
    units = {one["name"]: one["corner_deviation_px"] for one in placements}
    stated = [units[flown.flight.names[number]] for number in flown.there]
    surest = flown.seen[0].surest
    assert np.nanmin(surest[np.isfinite(surest)]) <= min(stated) * 1.1 + 1e-6
    assert (surest[np.isfinite(surest)] < 3 * max(stated)).all()


def test_the_ground_of_the_missing_frames_is_the_gap(flown: Flown) -> None:
    coverage, gaps = flown.seen
    missing = np.any([flown.inside(number) for number in MISSING], axis=0)
    bare = missing & ~np.any([flown.inside(number) for number in flown.there], axis=0)
    inside = [gap for gap in gaps if _cell(coverage, gap.inside, missing)]
    assert sum(gap.area for gap in inside) == pytest.approx(bare.sum() * coverage.grid.cell**2, rel=0.1)


def _cell(coverage: Coverage, place: tuple[float, float], flags: np.ndarray) -> bool:
    grid = coverage.grid
    return bool(flags[int((place[1] - grid.top) / grid.cell), int((place[0] - grid.left) / grid.cell)])
