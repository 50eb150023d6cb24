from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sitl.geometry import CameraState, Lens
from sitl.messages import position
from sitl.path import Plan, fly
from sitl.waypoints import shots_of


def item(number: int, command: int, *parameters: float) -> str:
    return "\t".join(map(str, (number, 0, 3, command, *parameters, 1)))


def place(x: float, y: float, height: float) -> tuple[float, float, float]:
    latitude, longitude, _, over_ground = position(CameraState(time=0, x=x, y=y, height=height, yaw=0, pitch=0, roll=0))
    return latitude / 1e7, longitude / 1e7, over_ground


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    lines = [
        "QGC WPL 110",
        item(0, 16, 0, 0, 0, 0, *place(0, 0, 0)),
        item(1, 16, 0, 0, 0, 0, *place(-50, 20, 80)),
        item(2, 206, 20, 0, 1, 0, 0, 0, 0),
        item(3, 16, 0, 0, 0, 0, *place(40, 20, 80)),
        item(4, 206, 0, 0, 0, 0, 0, 0, 0),
        item(5, 16, 0, 0, 0, 0, *place(40, 60, 80)),
    ]
    path = tmp_path / "m.waypoints"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_pictures_are_taken_by_distance_where_a_trigger_is_set(mission: Path) -> None:
    shots = shots_of(mission)
    assert np.allclose([one.x for one in shots], [-50, -30, -10, 10, 30], atol=0.6)  # single precision on the link
    assert np.allclose([one.y for one in shots], 20, atol=0.6)
    assert [one.height for one in shots] == pytest.approx([80] * 5)
    assert [one.course for one in shots] == pytest.approx([np.pi / 2] * 5, abs=0.02)


def test_the_scenario_flies_them(mission: Path) -> None:
    states = fly("mission", Lens(), Plan(waypoints=mission))
    assert len(states) == 5
    assert (np.diff([one.time for one in states]) > 0).all()


@pytest.mark.parametrize("text", ["", "QGC WPL 110\n"])
def test_what_is_no_mission_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "m").write_text(text)
    for path in (tmp_path / "m", tmp_path / "none"):
        with pytest.raises(ValueError, match=r"is no mission|no line on which"):
            shots_of(path)


def test_a_mission_without_a_file_is_refused() -> None:
    with pytest.raises(ValueError, match="wants --waypoints FILE"):
        fly("mission", Lens(), Plan())
