"""What counts as looked at, over HTTP."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.views import flight_view
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.web.seen_flight import seen_flight
from tests.web.small_flight import SmallFlight
from tests.web.test_notes_api import Writer

ASKED = {"session": "a", "island": 0, "columns": 3, "lines": 3, "who": "a"}
LOOKED = ASKED | {"level": 16, "seconds": 2.0}


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallFlight:
    for name in ("LEAST_REST_S", "MOST_REST_S"):
        monkeypatch.setattr(flight_view, name, 0.0)
    return seen_flight(tmp_path)


@pytest.fixture
def looker(shared: SmallFlight) -> Iterator[Writer]:
    server = WebServer(shared.root, HttpAddress("127.0.0.1", 0))
    yield Writer(server.start())
    server.stop()


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
