"""Whether a person would have been seen, over a simulated flight that was stitched: the map of it, its figures, its files, its
page."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.detection import detections as detections_module
from gcs_mosaic.detection.detection_areas import areas
from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.detection.detections import Detections, units_of_pixel
from gcs_mosaic.detection.persons import Clothes, Person, Posture
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView, places_of
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from sitl.flight import Flight, plan
from sitl.geometry import Lens
from sitl.path import Plan
from tests.notes.written_pins import write_pins
from tests.running import stitched
from tests.sure import sure
from tests.web.test_notes_api import Writer

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("every_answer_is_as_described")]

HEIGHT_M = 40.0
SIZE = (640, 480)


@pytest.fixture(scope="module")
def flight(world_cache: Path) -> Flight:
    return plan("survey", SIZE, seed=3, ground="floor", route=Plan(frames=6, height=HEIGHT_M), cache=world_cache)


@pytest.fixture(scope="module")
def root(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the stitched flight."""
    return stitched(flight, tmp_path_factory.mktemp("detection"))


@pytest.fixture(scope="module")
def detections(root: Path) -> Detections:
    view = FlightView(root)
    return Detections(view, IslandCoverage(view).of)


def told(
    detections: Detections, root: Path, clothes: Clothes = "orange", posture: Posture = "lying", smaller: float = 1.0
) -> DetectionMap:
    person = Person(posture=posture, clothes=clothes)
    gsd_m = HEIGHT_M / Lens(width=SIZE[0], height=SIZE[1]).focal_px
    pixel = units_of_pixel(FlightView(root), 0)
    assert pixel is not None
    found = detections.whole(0, person, person.side_m / gsd_m * pixel / smaller)
    assert found is not None
    assert found.measured == found.frames
    return found


def figure(found: DetectionMap) -> float:
    value = found.within(found.flown)
    assert value is not None
    return value


def test_clothes_that_stand_out_and_people_who_are_larger_are_more_probable(detections: Detections, root: Path) -> None:
    orange, brown = told(detections, root), told(detections, root, "brown")
    assert np.isfinite(orange.probability[orange.flown]).mean() > 0.97
    assert 0 <= np.nanmin(orange.probability) <= np.nanmax(orange.probability) <= 1
    assert figure(orange) > figure(brown) + 0.2
    assert figure(orange) > figure(told(detections, root, smaller=25.0)) + 0.1


def test_each_measured_picture_adds_what_it_saw(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detections_module, "REST", 0.0)
    monkeypatch.setattr(detections_module, "LEAST_REST_S", 0.0)
    view = FlightView(root)
    fresh = Detections(view, IslandCoverage(view).of)
    side = 20.0 * sure(units_of_pixel(view, 0))
    before = sure(fresh.of(0, Person(), side))
    assert before.measured == 0
    assert np.isnan(before.probability[before.is_seen]).all()
    assert before.within(before.is_seen) is None
    stated = np.isfinite(before.probability)  # gaps alone: there it is 0
    for measured in range(1, before.frames + 1):
        assert fresh.step()
        now = sure(fresh.of(0, Person(), side))
        assert now.measured == measured
        after = np.isfinite(now.probability)
        assert after[stated].all()
        assert after.sum() > stated.sum()
        assert (now.flown & ~after).any() or measured == before.frames
        stated = after
    assert not fresh.step()


def test_a_part_is_the_mean_of_its_cells_and_areas_hold_what_they_say(detections: Detections, root: Path) -> None:
    found = told(detections, root)
    left, top, right, bottom = found.grid.box
    whole = found.cells_in(np.array([(left, top), (right, top), (right, bottom), (left, bottom)]))
    assert (whole == found.flown).all()
    half = found.cells_in(
        np.array([(left, top), ((left + right) / 2, top), ((left + right) / 2, bottom), (left, bottom)])
    )
    assert found.within(half) == pytest.approx(float(np.nanmean(found.probability[half])))
    area = 0.0
    for one in areas(found):
        assert one.least <= one.mean <= one.most
        corners = [np.asarray(ring, np.float32) for ring in one.rings]
        area += cv2.contourArea(corners[0]) - sum(cv2.contourArea(ring) for ring in corners[1:])
    cells = float((found.flown & np.isfinite(found.probability)).sum()) * found.grid.cell**2
    assert area == pytest.approx(cells, rel=0.35)  # outlines run through the middles of half cells


def test_a_mission_and_the_geojson_tell_where_it_is_improbable(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    view = FlightView(root)
    frame = view.table().frames[0]
    painted = view.painted(frame.number)
    assert painted is not None
    corners = places_of(painted, np.array([(0, 0), (639, 0), (639, 479), (0, 479)], float))
    per_unit = HEIGHT_M / painted.camera.focal_px / np.exp(painted.pose.log_gsd) / 111_320
    write_pins(root, [(x, y, 8.5 + x * per_unit, -y * per_unit) for x, y in corners.tolist()])
    target = tmp_path / "map.geojson"
    asked = ["export", str(root), "--format", "geojson", "--to", str(target), "--person", "lying,brown"]
    assert main(asked) == 0
    features = json.loads(target.read_text())["features"]
    found = [one["properties"] for one in features if one["properties"]["is"] == "probability"]
    assert found
    assert all(one["from"] <= one["mean"] <= one["to"] and "clears no ground" in one["advice"] for one in found)
    plan_file = ["--format", "mission-waypoints", "--to", str(tmp_path / "gaps"), "--height", "40"]
    assert main(["export", str(root), *plan_file, "--below", "0.99", "--person", "lying,brown"]) == 0
    assert "patch" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("option", "value", "sentence"),
    [
        ("--below", "80", "is no probability"),
        ("--below", "nan", "is no probability"),
        ("--person", "tall", "is nobody"),
    ],
)
def test_what_makes_no_sense_is_refused(
    root: Path, option: str, value: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(root), "--format", "mission-plan", option, value]) == 2
    assert sentence in capsys.readouterr().err


@pytest.fixture
def client(root: Path) -> Iterator[Writer]:
    server = WebServer(root, HttpAddress("127.0.0.1", 0))
    yield Writer(server.start())
    server.stop()


def test_the_page_is_told_what_is_missing_and_then_how_probable_it_is(client: Writer) -> None:
    client_root = "/islands/0/detection"
    asked = f"{client_root}?posture=lying&clothes=orange&pixels=14"
    end = time.monotonic() + 60
    while (answer := client.get(asked))["measured"] < answer["frames"]:
        assert time.monotonic() < end, answer
        time.sleep(0.3)
    time.sleep(1.1)
    answer = client.get(f"{asked}&outline=-9000,-9000;9000,-9000;9000,9000;-9000,9000")
    assert answer["trouble"] == ""
    assert answer["by"] == "pixels"
    assert answer["person_px"] == 14
    assert 0.2 < answer["flown"] <= answer["seen"] <= 1
    assert answer["part"] == pytest.approx(answer["flown"])
    for bad in ("1,2;3,4", "a,b;c,d;e,f", "nan,1;2,3;4,5"):
        assert client.send("GET", f"{asked}&outline={bad}")[0] == 400
    assert client.send("GET", f"{client_root}?clothes=invisible")[0] == 400
    assert "flown" not in client.get("/islands/77/detection?pixels=5")
