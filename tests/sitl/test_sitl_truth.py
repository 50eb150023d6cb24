from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sitl.camera import Scene
from sitl.flight import Flight
from sitl.geometry import CameraState, pixels_from_ground
from sitl.targets import Crowd, spread
from sitl.truth import COLUMNS, ROWS, Truth, read, true_frame, write

OBLIQUE = CameraState(time=2, x=0, y=40, height=40, yaw=0.2, pitch=np.radians(72))


@pytest.mark.long
def test_what_is_written_is_read(flight: Flight, scene: Scene, tmp_path: Path) -> None:
    crowd = spread(Crowd(people=3, marks=1), flight.scene.camera.lens, flight.states, 60, seed=3)
    camera = replace(flight.scene.camera, exposure_step=2, vignetting=0.3)
    truth = replace(flight, scene=replace(flight.scene, camera=camera, targets=crowd)).truth()
    truth = replace(truth, frames=(*truth.frames, true_frame(scene, OBLIQUE, "oblique.jpg")))
    write(truth, tmp_path / "truth.json")
    again = read(tmp_path / "truth.json")
    assert again.lens == truth.lens
    assert again.gsd == truth.gsd
    assert again.targets == truth.targets == crowd
    assert again.vignetting == 0.3
    for one, other in zip(again.frames, truth.frames, strict=True):
        assert one.name == other.name
        assert one.state == other.state
        assert np.array_equal(one.grid_ground, other.grid_ground, equal_nan=True)
        assert np.array_equal(one.grid_used, other.grid_used)
        assert one.gain == other.gain
        assert [(s.target, *s.px, *s.ground) for s in one.sightings] == [
            (s.target, *s.px, *s.ground) for s in other.sightings
        ]
    assert sum(len(frame.sightings) for frame in again.frames) >= 4


def test_the_file_is_plain_json_row_by_row(flight: Flight, tmp_path: Path) -> None:
    write(flight.truth(), tmp_path / "truth.json")
    data = json.loads((tmp_path / "truth.json").read_text(), parse_constant=pytest.fail)
    frame = data["frames"][0]
    assert len(frame["grid_px"]) == len(frame["grid_ground"]) == COLUMNS * ROWS
    assert frame["grid_px"][0] == [0, 0]
    assert frame["grid_px"][COLUMNS - 1] == [frame["width"] - 1, 0]
    assert frame["grid_px"][-1] == [frame["width"] - 1, frame["height"] - 1]


def test_the_grid_lies_where_the_camera_saw_it(flight: Flight) -> None:
    truth = flight.truth()
    for frame in truth.frames:
        assert np.allclose(pixels_from_ground(truth.lens, frame.state, frame.grid_ground), frame.grid_px, atol=1e-3)
        assert frame.gsd == pytest.approx(frame.state.height / truth.lens.focal_px, rel=0.02)


def test_relief_is_in_the_truth(flight: Flight) -> None:
    hilly = replace(flight, scene=replace(flight.scene, relief=1.0)).truth()
    frame, flat = hilly.frames[0], flight.truth().frames[0]
    assert frame.grid_height.max() > 1
    assert np.abs(frame.grid_ground - flat.grid_ground).max() > 0.2


def test_sky_and_the_far_country_do_not_count(scene: Scene) -> None:
    frame = true_frame(scene, OBLIQUE, "oblique.jpg")
    sky = np.asarray(np.isnan(frame.grid_ground).any(1))
    assert sky[:COLUMNS].all()
    assert not sky[-COLUMNS:].any()
    assert not frame.grid_used[sky].any()
    assert frame.grid_used[-COLUMNS:].all()
    assert frame.grid_used.sum() < (~sky).sum()


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"format": 1}', '{"format": 2, "lens": {}, "frames": [{}]}'])
def test_another_file_is_refused_in_a_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(ValueError, match=r"truth\.json is not a truth"):
        read(tmp_path / "truth.json")


def test_the_median_frame_gives_the_pixel(flight: Flight) -> None:
    truth = flight.truth()
    three = Truth(lens=truth.lens, frames=tuple(replace(truth.frames[0], gsd=gsd) for gsd in (0.1, 0.2, 9.0)))
    assert three.gsd == 0.2
