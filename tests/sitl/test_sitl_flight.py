from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from sitl.camera import Camera
from sitl.flight import camera_names, make, plan, world_size_for
from sitl.geometry import Lens
from sitl.path import Plan, fly
from sitl.truth import read

SMALL = Plan(frames=6, height=60)


@pytest.mark.long
def test_a_flight_is_made_whole_with_its_truth(tmp_path: Path) -> None:
    flight = make("survey", tmp_path, (320, 240), seed=3, world_size=2048, route=SMALL)
    truth = read(tmp_path / "truth.json")
    assert [frame.name for frame in truth.frames] == list(flight.names)
    assert [frame.state for frame in truth.frames] == list(flight.states)
    for name in flight.names:
        picture = cv2.imread(str(tmp_path / name))
        assert picture is not None
        assert picture.shape == (240, 320, 3)


@pytest.mark.long
def test_the_same_seed_makes_the_same_files() -> None:
    flights = [plan("survey", (160, 120), seed=seed, world_size=2048, route=SMALL) for seed in (3, 3, 4)]
    first, again, other = (next(flight.pictures()) for flight in flights)
    assert first == again != other


def test_pictures_come_in_order_and_all_of_them() -> None:
    flight = plan("survey", (160, 120), seed=3, world_size=2048, route=replace(SMALL, frames=9))
    expected = [flight.scene.encoded(state, k) for k, state in enumerate(flight.states)]
    assert list(flight.pictures()) == expected


def test_the_camera_given_keeps_its_lens_and_takes_the_size() -> None:
    camera = Camera(lens=Lens(focal=2.0, k1=0.1), noise=0)
    flight = plan("survey", (160, 120), seed=3, world_size=2048, route=SMALL, camera=camera)
    assert flight.scene.camera == replace(camera, lens=Lens(width=160, height=120, focal=2.0, k1=0.1))


def test_an_unknown_scenario_is_refused_with_those_there_are() -> None:
    with pytest.raises(
        ValueError, match="'loop' is no scenario; there are survey, climb, lost, oblique, ahead, line, circle, mission"
    ):
        plan("loop")


@pytest.mark.long
def test_a_world_is_as_large_as_its_flight_needs() -> None:
    lens = Lens(width=160, height=120)
    short, long = (fly("survey", lens, Plan(frames=frames)) for frames in (4, 300))
    assert world_size_for(short, lens) == 2048
    assert world_size_for(long, lens) > 6144
    assert plan("survey", (160, 120), route=Plan(frames=4)).truth().frames[0].grid_used.all()


@pytest.mark.long
def test_a_flight_beyond_every_world_is_refused() -> None:
    lens = Lens(width=160, height=120)
    with pytest.raises(ValueError, match="fly lower"):
        world_size_for(fly("survey", lens, Plan(frames=3000, height=300)), lens)


def test_names_go_on_in_a_new_folder_and_never_repeat() -> None:
    names = list(camera_names(2500))
    assert names[0] == "DCIM/100MEDIA/IMG_0001.JPG"
    assert names[999] == "DCIM/101MEDIA/IMG_1000.JPG"
    assert len({name.rsplit("/", 1)[1] for name in names}) == 2500
