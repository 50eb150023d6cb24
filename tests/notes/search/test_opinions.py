"""Second opinions on finds."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.notes.mapped import MappedFlight
from tests.web.test_notes_api import HERE, Writer

pytestmark = pytest.mark.usefixtures("every_answer_is_as_described")


@pytest.fixture
def client(flight: MappedFlight) -> Iterator[Writer]:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    yield Writer(server.start())
    server.stop()


def test_others_say_what_they_think_of_a_find_by_name_and_may_think_again(client: Writer) -> None:
    made = client.send("POST", "/finds", HERE)[1]
    path = f"/finds/{made['id']}/opinions"
    assert client.send("POST", path, {"opinion": "no", "who": "Lou"})[0] == 200
    client.send("POST", path, {"opinion": "unsure", "who": "Max"})
    client.send("POST", path, {"opinion": "yes", "who": "Lou"})
    told = client.get("/opinions")["opinions"]
    assert {one["who"]: one["opinion"] for one in told} == {"Lou": "yes", "Max": "unsure"}
    status, sentence = client.send("POST", path, {"opinion": "yes", "who": made["who"]})
    assert status == 400
    assert "somebody else" in sentence
    assert client.send("POST", path, {"opinion": "perhaps", "who": "Lou"})[0] == 400
    assert client.send("POST", "/finds/99/opinions", {"opinion": "no", "who": "Lou"})[0] == 404
