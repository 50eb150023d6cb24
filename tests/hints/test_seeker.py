"""Hints of a simulated flight with people: sought in its frames, and by the page in a process of its own."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.hints.hint_file import HintsRead, read_hints
from gcs_mosaic.hints.hint_places import hint_places
from gcs_mosaic.hints.ranking import ranked
from gcs_mosaic.hints.seeker import AnalysedFrame, Seeker
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour
from gcs_mosaic.store.folder import HINTS_NAME
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from sitl.flight import Flight, plan
from sitl.path import Plan
from sitl.targets import CLOTHES, Crowd
from tests.benchmarks.hints import found_people, people_by_frame
from tests.running import stitched, until
from tests.web.browser import CHROMIUM, open_browser
from tests.web.test_notes_api import Writer
from tests.web.test_people_on_the_page import Person

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("every_answer_is_as_described")]

SIZE = (800, 600)
PEOPLE = 12
FRAMES = 12
SEARCHED_S = 200.0  # the search yields to all other work of a busy machine


@pytest.fixture(scope="module")
def flight(world_cache: Path) -> Flight:
    return plan(
        "survey", SIZE, seed=3, route=Plan(frames=FRAMES, height=40), crowd=Crowd(people=PEOPLE), cache=world_cache
    )


@pytest.fixture(scope="module")
def flown(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the stitched flight, in which nothing was sought yet."""
    return stitched(flight, tmp_path_factory.mktemp("people"))


@pytest.fixture(scope="module")
def searched_once(flown: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, and all its frames are searched."""
    folder = Path(shutil.copytree(flown, tmp_path_factory.mktemp("searched") / "mosaic"))
    assert len(seek_all(folder)) == FRAMES
    return folder


@pytest.fixture
def searched(searched_once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(searched_once, tmp_path / "searched"))


@pytest.fixture
def root(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "mosaic"))


def seek_all(root: Path, *colours: SoughtColour, settings: HintSettings | None = None) -> list[int]:
    """Search all frames; their numbers in the order in which they were searched."""
    seeker, done = Seeker(root, settings or HintSettings()), []
    while (number := seeker.step(colours)) is not None:
        done.append(number)
    seeker.close()
    return done


def test_people_are_found_far_above_chance_the_newest_frame_first(flight: Flight, root: Path) -> None:
    done = seek_all(root)
    assert done == sorted(done, reverse=True)
    assert len(done) == len(flight.names)
    read, people = read_hints(root), people_by_frame(flight, root)
    shown = ranked(read, hint_places(FlightView(root), read.hints), 20, 1)
    found = found_people(shown, people)
    seen = {number for each in people.values() for number in each}
    assert len(set().union(*found)) >= 0.5 * len(seen)
    assert sum(bool(each) for each in found[:10]) >= 7
    by_chance = found_people(shown, people, np.random.default_rng(1).uniform(0, 1, (len(shown), 2)) * SIZE)
    assert len(set().union(*by_chance)) <= 1
    assert seek_all(root) == []


def test_hints_lie_where_the_frames_are(searched: Path) -> None:
    read, view = read_hints(searched), FlightView(searched)
    places = hint_places(view, read.hints)
    assert set(places) == {hint.id for hint in read.hints}
    table = view.table()
    for hint in read.hints:
        place = places[hint.id]
        near = {table.frames[index].number for index in table.near(place.island, (place.x, place.y, place.x, place.y))}
        assert hint.found.frame in near


def test_a_colour_is_sought_in_frames_that_were_searched_before_and_forgotten_again(searched: Path) -> None:
    orange = SoughtColour(number=7, bgr=tuple(round(value) for value in CLOTHES[0]), tolerance=25.0)  # type: ignore[arg-type]
    assert len(seek_all(searched, orange)) == FRAMES
    sought = [hint for hint in read_hints(searched).hints if hint.found.kind == "sought"]
    assert sought
    assert {hint.found.what for hint in sought} == {7}
    assert seek_all(searched, orange) == []
    seeker = Seeker(searched, HintSettings())
    seeker.step()
    seeker.close()
    assert not [hint for hint in read_hints(searched).hints if hint.found.kind == "sought"]


def test_a_frame_whose_original_is_gone_costs_that_frame(root: Path) -> None:
    first = sorted((root / "frames").rglob("*.*"))[0]
    first.write_bytes(b"no picture")
    assert len(seek_all(root)) == 12
    assert read_hints(root).failed == 1


def test_a_frame_that_ends_the_program_is_begun_once_more_and_then_left(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    whole = Seeker._search
    for times in (1, 2):
        monkeypatch.setattr(Seeker, "_search", killed)
        seeker = Seeker(root, HintSettings())
        with pytest.raises(KeyboardInterrupt):
            seeker.step()
        seeker.close()
        monkeypatch.setattr(Seeker, "_search", whole)
        seeker = Seeker(root, HintSettings())
        assert (12 in seeker._searched) == (times == 2)
        seeker.close()
    assert seek_all(root)[0] == 11


def test_trouble_that_passes_costs_no_frame_and_a_fault_costs_that_frame_alone(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Seeker._search

    def locked(*_: object) -> None:
        raise sqlite3.OperationalError("database is locked")

    monkeypatch.setattr(Seeker, "_search", locked)
    for _ in range(3):
        seeker = Seeker(root, HintSettings())
        with pytest.raises(sqlite3.OperationalError):
            seeker.step()
        seeker.close()

    def faulty(self: Seeker, frame: AnalysedFrame, colours: Sequence[SoughtColour]) -> None:
        if frame.number == 12:
            raise ZeroDivisionError
        whole(self, frame, colours)

    monkeypatch.setattr(Seeker, "_search", faulty)
    assert len(seek_all(root)) == 12
    read = read_hints(root)
    assert (read.searched, read.failed) == (11, 1)


def test_hints_of_another_flight_and_a_damaged_file_are_not_shown(searched: Path) -> None:
    assert read_hints(searched) != HintsRead()
    ledger = sqlite3.connect(searched / "flight.sqlite")
    ledger.execute("UPDATE flight SET name = 'another'")
    ledger.commit()
    ledger.close()
    assert read_hints(searched) == HintsRead()
    assert len(seek_all(searched)) == FRAMES  # from the beginning
    (searched / HINTS_NAME).write_bytes(b"x" * 4096)
    assert read_hints(searched) == HintsRead()


@pytest.fixture
def client(root: Path) -> Iterator[Writer]:
    server = WebServer(root, HttpAddress("127.0.0.1", 0))
    yield Writer(server.start())
    server.stop()


def test_the_page_seeks_once_somebody_wants_it_and_what_is_dismissed_stays_so(client: Writer, root: Path) -> None:
    told = client.get("/hints")
    assert (told["on"], told["state"], told["hints"]) == (False, "off", [])
    assert client.send("POST", "/hints", {"on": True, "who": "Kim"})[0] == 200
    until(lambda: client.get("/hints")["searched"] == 12, "all frames are searched", SEARCHED_S)
    told = client.get("/hints")
    assert (told["on"], told["state"], told["frames"], told["failed"]) == (True, "seeking", 12, 0)
    best = told["hints"][0]
    assert set(best) == {
        *(
            "hint",
            "reason",
            "what",
            "worth",
            "utc",
            "island",
            "place",
            "frame",
            "name",
            "pixel",
            "size",
            "seen",
            "looks",
        )
    }
    assert client.send("POST", "/hints/dismissed", {"hint": best["hint"], "who": "Kim"})[0] == 200
    assert best["hint"] not in [one["hint"] for one in client.get("/hints")["hints"]]
    assert client.send("POST", "/hints", {"on": False, "who": "Kim"})[0] == 200
    until(lambda: client.get("/hints")["state"] == "off", "the process has ended", 10)


@pytest.mark.thorough
def test_a_colour_picked_on_the_map_is_marked_everywhere(client: Writer, flight: Flight, root: Path) -> None:
    frame, sight = next((frame, one) for frame in flight.truth().frames for one in frame.sightings)
    number = next(one.number for one in FlightView(root).table().frames if one.name == Path(frame.name).name)
    pixel = [float(sight.px[0]), float(sight.px[1])]
    status, made = client.send(
        "POST", "/hints/colours", {"frame": number, "pixel": pixel, "label": "jacket", "who": "Kim"}
    )
    assert status == 201
    data = next(data for name, data in zip(flight.names, flight.pictures(), strict=True) if name == frame.name)
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    own = picture[round(pixel[1]), round(pixel[0])]
    assert np.abs(np.array(made["rgb"][::-1]) - own).max() < 40
    client.send("POST", "/hints", {"on": True, "who": "Kim"})
    marked = "the colour is marked where it was picked"
    until(
        lambda: any(one["frame"] == number and _near(one["pixel"], pixel) for one in _sought(client)),
        marked,
        SEARCHED_S,
    )
    assert client.send("DELETE", f"/hints/colours/{made['id']}", {"who": "Kim"})[0] == 200
    assert client.send("DELETE", f"/hints/colours/{made['id']}", {"who": "Kim"})[0] == 404


def _sought(client: Writer) -> list[dict[str, Any]]:
    return [one for one in client.get("/hints")["hints"] if one["reason"] == "sought"]


def _near(one: list[float], other: list[float]) -> bool:
    return float(np.hypot(one[0] - other[0], one[1] - other[1])) < 15


@pytest.mark.parametrize(
    ("path", "body", "said"),
    [
        ("/hints", {"on": 1}, "on is to be true or false"),
        ("/hints/colours", {"rgb": [1, 2]}, "three whole numbers"),
        ("/hints/colours", {"rgb": [1, 2, 300]}, "rgb is to be a whole number"),
        ("/hints/colours", {"frame": 9999, "pixel": [1, 1]}, "no such frame"),
        ("/hints/colours", {"frame": 1, "pixel": [-9, 1]}, "inside the frame"),
        ("/hints/colours", {"island": 0, "x": 1e6, "y": 1e6}, "No frame has seen"),
        ("/hints/colours", {"rgb": [1, 2, 3], "tolerance": 1e9}, "tolerance is to be"),
    ],
)
def test_what_is_unfit_is_refused_in_a_sentence(client: Writer, path: str, body: dict[str, object], said: str) -> None:
    status, text = client.send("POST", path, {**body, "who": "Kim"})
    assert (status, said in text) == (400, True), text


def test_a_model_that_cannot_be_used_is_told_and_the_page_lives_on(root: Path, tmp_path: Path) -> None:
    (tmp_path / "no.onnx").write_bytes(b"nothing")
    settings = HintSettings(enabled=True, model=str(tmp_path / "no.onnx"))
    server = WebServer(root, HttpAddress("127.0.0.1", 0), hints=settings)
    client = Writer(server.start())
    until(lambda: client.get("/hints")["state"] == "refused", "the model is refused", 60)
    assert "no model" in client.get("/hints")["trouble"]
    assert json.loads(client.ask("/mosaic.json")[1])["islands"]
    server.stop()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_somebody_switches_hints_on_goes_to_one_dismisses_it_and_brings_it_back(searched: Path, tmp_path: Path) -> None:
    """That frames are searched once it is switched on is tested without a browser."""
    server = WebServer(searched, HttpAddress("127.0.0.1", 0))
    with open_browser(tmp_path / "profile") as page:
        someone = Person(page, server.start())
        someone.press("open-hints")
        someone.sees("hints-told", "Hints are off.")
        someone.press("hints-on")
        page.wait_for("document.querySelectorAll('#hints-list li').length >= 5", SEARCHED_S)
        all_searched = "document.getElementById('hints-told').innerText.includes('12 of 12 frames are searched.')"
        page.wait_for(all_searched, SEARCHED_S)
        for place in (0, 2, -1):  # crops are fetched once they are in view
            crop = f"[...document.querySelectorAll('#hints-list img')].at({place})"
            page.evaluate(f"{crop}.scrollIntoView()")
            page.wait_for(f"{crop}.naturalWidth > 0")
        first = "document.querySelector('#hints-list li:first-child')"
        page.evaluate(f"{first}.querySelector('.crop').click()")
        marks = "[...document.querySelectorAll('.hint-mark')].map((one) => one.getBoundingClientRect())"
        pane = "document.getElementById('map').getBoundingClientRect()"
        middle = f"Math.abs(one.x + one.width / 2 - ({pane}.x + {pane}.width / 2)) < 3"
        page.wait_for(f"{marks}.some((one) => {middle})")
        key = f"{first}.querySelector('.crop').dataset.hint"
        best = page.evaluate(key)
        page.evaluate(f"[...{first}.querySelectorAll('button')].at(-1).click()")
        page.wait_for(f"{key} !== {json.dumps(best)}")
        page.evaluate("document.querySelector('#hints-undo button').click()")
        page.wait_for(f"{key} === {json.dumps(best)}")
        someone.press("hints-pick")
        someone.sees("hint", "Click the colour.")
        someone.click(500, 400)
        page.wait_for("document.querySelectorAll('#hints-colours li').length === 1", 30)
        page.evaluate("document.querySelector('#hints-colours button').click()")
        page.wait_for("document.querySelectorAll('#hints-colours li').length === 0", 30)
        page.open("about:blank")
    server.stop()
