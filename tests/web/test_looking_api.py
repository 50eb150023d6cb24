"""What counts as looked at, over HTTP."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.notes.search import looking
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import flight_view
from gcs_mosaic.web.api import looking as looking_api
from gcs_mosaic.web.api import reviews as reviews_api
from tests.factories import frame
from tests.web.seen_flight import CAMERA, HOLE, seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight
from tests.web.test_notes_api import Writer

ASKED = {"session": "a", "island": 0, "columns": 3, "lines": 3, "who": "a"}
LOOKED = ASKED | {"level": 16, "seconds": 2.0}


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallFlight:
    for name in ("LEAST_REST_S", "MOST_REST_S"):
        monkeypatch.setattr(flight_view, name, 0.0)
    for api in (looking_api, reviews_api):
        monkeypatch.setattr(api, "SHOWN_S", 0.0)
    return seen_flight(tmp_path)


@pytest.fixture
def looker(shared: SmallFlight) -> Iterator[Writer]:
    with served(shared.root) as url:
        yield Writer(url)


def post(looker: Writer, body: dict[str, Any]) -> Any:
    status, told = looker.send("POST", "/looking", body)
    assert status == 200, told
    return told


def test_a_patch_that_the_page_never_showed_is_not_counted(looker: Writer) -> None:
    """The answer that lent it was lost: the page still shows the one before."""
    first = post(looker, ASKED)["patch"]["box"]
    lost = post(looker, LOOKED | {"looked": first})
    assert lost["counted"]
    again = post(looker, LOOKED | {"looked": first})
    assert not again["counted"]
    assert (again["patch"], again["left"]) == (lost["patch"], lost["left"])
    assert post(looker, LOOKED | {"looked": first, "put_off": True})["patch"] == lost["patch"]
    assert not post(looker, LOOKED)["counted"]
    assert post(looker, LOOKED | {"looked": lost["patch"]["box"]})["counted"]


def test_a_look_from_further_away_does_not_count(looker: Writer) -> None:
    box = post(looker, ASKED)["patch"]["box"]
    assert not post(looker, LOOKED | {"looked": box, "level": 14})["counted"]
    assert post(looker, LOOKED | {"looked": box, "level": 15})["counted"]


def paint(flight: SmallFlight, name: str, x: float, y: float) -> None:
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_painted(RenderItem(name=name, order=99, island=0, pose=Pose(x, y), camera=CAMERA, level=16))
    flight.write()


def arrive(flight: SmallFlight, name: str) -> None:
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame(name, modified=1.7e9))
        ledger.record_size(name, CAMERA.width, CAMERA.height, 0.2)


def test_what_was_painted_while_somebody_looked_is_to_be_looked_at(shared: SmallFlight, looker: Writer) -> None:
    """Before the key was pressed, and a frame that came earlier and is placed late."""
    arrive(shared, "late.jpg")
    arrive(shared, "new.jpg")
    lent = post(looker, ASKED)
    box, cells = lent["patch"]["box"], lent["cells"]
    paint(shared, "new.jpg", box[0] + 150, box[1] + 150)
    again = post(looker, LOOKED | {"looked": box})
    assert again["counted"]
    assert again["patch"]["box"] == box
    assert again["left"] < cells
    nothing_came = post(looker, LOOKED | {"looked": box})
    assert nothing_came["patch"]["box"] != box
    paint(shared, "late.jpg", box[0] + 150, box[1] + 150)
    assert post(looker, ASKED)["left"] > nothing_came["left"]


def test_what_was_painted_during_a_look_about_is_to_be_reviewed(shared: SmallFlight, looker: Writer) -> None:
    arrive(shared, "new.jpg")
    query = "/reviews?island=0&left=-100&top=-100&right=900&bottom=600&level=16"
    every = len(looker.get(query)["missing"])
    paint(shared, "new.jpg", 200.0 * HOLE[0], 150.0 * HOLE[1])
    looker.get(query)  # the server knows of it
    look = {"island": 0, "box": [-100, -100, 900, 600], "level": 16, "seconds": 3, "who": "a"}
    assert looker.send("POST", "/reviews", look)[0] == 202
    told = looker.get(query)
    assert told["reviewed"]
    assert len(told["missing"]) >= 4, every


@pytest.mark.long
def test_leases_end_by_themselves(looker: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking, "LENT_S", 4.0)
    first = post(looker, ASKED)["patch"]
    other = post(looker, ASKED | {"session": "b", "who": "b"})
    assert apart(first["box"], other["patch"]["box"])
    assert [one["who"] for one in other["others"]] == ["a"]
    assert looker.send("POST", "/looking/keep", {"session": "a"})[1] == {"kept": True}
    time.sleep(4.5)
    assert looker.send("POST", "/looking/keep", {"session": "a"})[1] == {"kept": False}
    assert post(looker, ASKED | {"session": "c", "who": "c"})["patch"]["box"] == first["box"]


def apart(one: list[float], other: list[float]) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


def test_of_a_part_without_frames_nothing_is_known(looker: Writer) -> None:
    told = post(looker, ASKED | {"island": 7})
    assert (told["patch"], told["cells"], told["left"]) == (None, 0, 0)
