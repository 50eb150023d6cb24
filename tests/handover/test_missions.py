"""Gaps become a mission that others' programs read: over the gap, at the flight's own height; and it is refused in a sentence."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from pykml.parser import Schema, fromstring
from pymavlink import mavutil, mavwp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_mosaic.cli.main import main
from tests.handover.gapped import HEIGHT_M, HOLE, METRES, canvas, gapped_flight

ARMING = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_DO_SET_MODE,
}
Places = list[tuple[float, float]]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    return gapped_flight(tmp_path / "flight")


def exported(flight: Path, kind: str, *options: str) -> Path:
    target = flight.parent / f"gaps.{kind}"
    assert main(["export", str(flight), "--format", f"mission-{kind}", "--to", str(target), *options]) == 0
    return target


def refusal(flight: Path, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    assert main(["export", str(flight), "--format", "mission-plan", *options]) == 2
    assert not (flight / "gaps.plan").exists()
    return capsys.readouterr().err


def waypoints(path: Path) -> list[Any]:
    """As pymavlink reads them, home first."""
    mavutil.set_dialect("ardupilotmega")  # of the version that the environment says by now
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    return [loader.wp(k) for k in range(loader.count())]


def lines(path: Path) -> list[tuple[Places, float]]:
    """From, to on the canvas, and metres between pictures."""
    found, items = [], waypoints(path)[1:]
    for first, trigger, last, end in zip(*(items[k::4] for k in range(4)), strict=True):
        kinds = [item.command for item in (first, trigger, last, end)]
        assert kinds == [mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST] * 2
        assert (trigger.param3, end.param1) == (1, 0)
        found.append(([canvas(item.y, item.x) for item in (first, last)], trigger.param1))
    return found


def test_what_a_camera_sees_from_the_lines_covers_the_hole(flight: Path) -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(350, 550, 41), np.linspace(270, 330, 13)))
    side = 300  # units that a picture sees at least across its way
    seen = np.zeros(x.shape, bool)
    for (a, b), step in lines(exported(flight, "waypoints")):
        way = np.subtract(b, a)
        length = float(np.hypot(*way))
        for k in range(int(length * METRES / step) + 1):
            middle = np.add(a, way * (k * step / METRES / length))
            seen |= np.hypot(x - middle[0], y - middle[1]) < side / 2
    assert seen.all()


def test_the_first_and_the_last_picture_of_a_line_show_known_ground(flight: Path) -> None:
    for ends, _ in lines(exported(flight, "waypoints")):
        for x, y in ends:
            inside = HOLE[0][0] < x < HOLE[1][0] and HOLE[0][1] < y < HOLE[1][1]
            assert not inside
            assert abs(x - 450) < 250, "nor does it go far beyond"
            assert abs(y - 300) < 180


def test_height_and_distance_are_those_of_the_flight(flight: Path) -> None:
    items = waypoints(exported(flight, "waypoints"))
    assert {round(item.z, 1) for item in items if item.command == 16 and item.seq} == {round(HEIGHT_M, 1)}
    assert {item.frame for item in items[1:]} == {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    steps = [step for _, step in lines(flight.parent / "gaps.waypoints")]
    assert steps == pytest.approx([30 * 0.4] * len(steps), abs=0.1)
    assert canvas(items[0].y, items[0].x) == pytest.approx((0.0, 0.0), abs=1.0)  # where the flight began


def test_nothing_arms_takes_off_or_lands(flight: Path) -> None:
    plan = json.loads(exported(flight, "plan").read_text())
    commands = {item["command"] for item in plan["mission"]["items"]}
    assert commands == {16, 206}
    assert not commands & ARMING
    assert any("Advice only" in text for text in plan["gcs_mosaic"]["advice"])
    assert any("above home" in text for text in plan["gcs_mosaic"]["advice"])


def test_all_files_tell_the_same_places(flight: Path) -> None:
    from_waypoints = [(item.y, item.x) for item in waypoints(exported(flight, "waypoints"))[1:] if item.command == 16]
    plan = json.loads(exported(flight, "plan").read_text())["mission"]["items"]
    assert [item["doJumpId"] for item in plan] == list(range(1, len(plan) + 1))
    from_plan = [(item["params"][5], item["params"][4]) for item in plan if item["command"] == 16]
    kml = fromstring(exported(flight, "kml").read_bytes())
    Schema("ogckml22.xsd").assertValid(kml)
    spots = [one.text.split() for one in kml.iter("{http://www.opengis.net/kml/2.2}coordinates")]
    from_kml = [tuple(map(float, spot.split(",")[:2])) for line in spots for spot in line]
    gpx = ElementTree.parse(exported(flight, "gpx"))
    from_gpx = [
        (float(one.attrib["lon"]), float(one.attrib["lat"]))
        for one in gpx.iter("{http://www.topografix.com/GPX/1/1}rtept")
    ]
    for other in (from_plan, from_kml, from_gpx):
        assert np.abs(np.subtract(other, from_waypoints)).max() < 1e-6  # 0.1 m; pymavlink keeps single precision


def test_ground_that_few_frames_saw_is_flown_on_demand_and_the_edge_is_not(flight: Path) -> None:
    for (a, b), _ in lines(exported(flight, "waypoints", "--looks", "4")):
        for x, y in (a, b):
            assert -50 < x < 950
            assert -50 < y < 650
    both = lines(flight.parent / "gaps.waypoints")
    assert sum(math.dist(*ends) for ends, _ in both) > sum(
        math.dist(*ends) for ends, _ in lines(exported(flight, "waypoints"))
    )


def test_what_is_too_coarse_is_flown_lower(flight: Path) -> None:
    items = waypoints(exported(flight, "waypoints", "--gsd", "0.05"))  # half of what it was flown at, 0.1 m
    assert {round(item.z, 1) for item in items if item.command == 16 and item.seq} == {round(HEIGHT_M / 2, 1)}
    ends = np.array([end for pair, _ in lines(flight.parent / "gaps.waypoints") for end in pair])
    assert np.ptp(ends, axis=0).min() > 500, "all of the flown area is"


def test_without_an_anchor_it_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = gapped_flight(tmp_path / "flight", pinned=False)
    assert "The map has no anchor, and so no longitude to fly to: set two pins" in refusal(flight, capsys)


@pytest.mark.parametrize(("deviation", "told"), [(None, "angle of view ("), (0.7, "but for a factor of 4.1")])
def test_without_a_height_it_is_refused_until_one_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], deviation: float | None, told: str
) -> None:
    flight = gapped_flight(tmp_path / "flight", deviation)
    said = refusal(flight, capsys)
    assert told in said
    assert "--height METRES" in said
    items = waypoints(exported(flight, "waypoints", "--height", "80"))
    assert {item.z for item in items if item.command == 16 and item.seq} == {80.0}
    assert "as given" in capsys.readouterr().out


def test_an_uncertain_height_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exported(gapped_flight(tmp_path / "flight", 0.05), "plan")
    assert "above home (by the pictures, ± 11%)" in capsys.readouterr().out


def test_without_a_gap_it_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.handover.gapped.is_missing", lambda x, y: False)
    flight = gapped_flight(tmp_path / "flight")
    assert "There is nothing to fly again: inside the flown area there is no gap" in refusal(flight, capsys)
    assert "seen fewer than 2 times" in refusal(flight, capsys, "--looks", "2")


@pytest.mark.parametrize(
    "words",
    [["--looks", "0"], ["--gsd", "nan"], ["--height", "-3"], ["--height", "x"], ["--island", "7"], ["--zoom", "3"]],
)
def test_bad_wishes_are_refused(flight: Path, capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    assert words[1] in refusal(flight, capsys, *words) or words[0] in refusal(flight, capsys, *words)


def test_patches_are_flown_one_after_the_other(flight: Path) -> None:
    numbers = [
        int(str(one.text).split()[1])
        for one in ElementTree.parse(exported(flight, "gpx", "--looks", "3")).iter(
            "{http://www.topografix.com/GPX/1/1}name"
        )
        if str(one.text).startswith("patch ")
    ]
    assert all(0 <= after - before <= 1 for before, after in pairwise(numbers))


def test_that_nothing_is_improbable_is_said_of_the_model(
    flight: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Patches are of some size, and the model is one: that somebody would have been seen everywhere it does not tell."""
    monkeypatch.setattr("gcs_mosaic.handover.mission.Detections.whole", lambda *_: None)
    said = " ".join(refusal(flight, capsys, "--below", "0.5").split())
    assert "by the model no patch of the flown area is below 50% for that person, which clears no ground" in said
