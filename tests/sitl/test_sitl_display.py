"""What stands still in the picture: where the ground moves, it does not, and of its readings some change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sitl.camera import Scene
from sitl.display import Display, readings
from sitl.geometry import CameraState
from sitl.sensor import Sensor

HERE = CameraState(time=3, x=-8, y=5, height=60, yaw=0.1)
THERE = CameraState(time=64, x=14, y=-9, height=63, yaw=0.4)
NOTHING = Display(readings=False, logo=False, bars=0, leg=False, specks=0)


def taken(scene: Scene, display: Display | None, **sensor: int) -> list[np.ndarray]:
    """Two pictures."""
    camera = replace(scene.camera, display=display, noise=0.0, sensor=Sensor(**sensor))
    return [replace(scene, camera=camera).picture(state, k) for k, state in enumerate((HERE, THERE))]


def test_a_display_of_nothing_changes_nothing(scene: Scene) -> None:
    for plain, shown in zip(taken(scene, None), taken(scene, NOTHING), strict=True):
        assert np.array_equal(plain, shown)


def test_what_is_burnt_in_stands_still(scene: Scene) -> None:
    plain, shown = taken(scene, None), taken(scene, replace(NOTHING, logo=True, bars=0.05))
    drawn = [(one != other).any(-1) for one, other in zip(plain, shown, strict=True)]
    assert 0.09 < drawn[0].mean() < 0.15
    both = drawn[0] & drawn[1]
    assert both.sum() > 0.95 * max(one.sum() for one in drawn)
    assert np.abs(shown[0][both].astype(int) - shown[1][both]).mean() < 5
    assert (shown[0][:24] == 0).all()
    assert (shown[0][-24:] == 0).all()


def test_a_leg_and_dirt_take_light(scene: Scene) -> None:
    passed = replace(NOTHING, leg=True, specks=4).passed((640, 480))
    assert passed.max() == pytest.approx(1, abs=1e-3)
    assert 0.01 < (passed < 0.5).mean() < 0.05
    plain, shown = taken(scene, None), taken(scene, replace(NOTHING, leg=True))
    assert shown[0][470, 585].mean() < 0.3 * plain[0][470, 585].mean()


def test_some_readings_change_and_some_do_not() -> None:
    before, after = readings(HERE, 0), readings(THERE, 1)
    assert [place for _, *place in before] == [place for _, *place in after]
    changed = {one for (one, *_), (other, *_) in zip(before, after, strict=True) if one != other}
    assert changed == {"ALT  60.0 M", "HDG 006", "REC 00:03"}


def test_writing_is_seen_on_dark_and_on_bright_ground(scene: Scene) -> None:
    plain, shown = taken(scene, None), taken(scene, replace(NOTHING, readings=True))
    written = (plain[0] != shown[0]).any(-1)
    assert 0.005 < written.mean() < 0.05
    assert (shown[0][written] == 0).all(-1).sum() > 500
    assert (shown[0][written] > 240).all(-1).sum() > 300


@pytest.mark.parametrize("sensor", [{"bands": 5, "depth": 16}, {"bands": 1, "depth": 16}])
def test_any_sensor_can_have_a_display(scene: Scene, sensor: dict[str, int]) -> None:
    plain, shown = taken(scene, None, **sensor), taken(scene, Display(), **sensor)
    assert shown[0].dtype == plain[0].dtype
    assert shown[0].shape == plain[0].shape
    assert (shown[0] != plain[0]).mean() > 0.1
