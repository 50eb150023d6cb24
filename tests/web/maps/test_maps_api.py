"""What the page tells of other maps: the addresses as others reach them, and codes of them."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from gcs_mosaic.web import access as module
from gcs_mosaic.web import invitation as invitations
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api.maps import NAMES, is_refused_by_qgroundcontrol
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.token import Access
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight
from tests.web.test_notes_api import Writer

TOKEN = "abcdefgh23456789"


@pytest.fixture
def everywhere(flight: AnchoredFlight) -> Iterator[Writer]:
    server = WebServer(flight.root, HttpAddress("0.0.0.0", 0), Feed(), access=Access(token=TOKEN))
    client = Writer(server.start())
    flight.set_pins(client)
    yield client
    server.stop()


def test_others_get_the_address_of_the_network_with_the_token(
    everywhere: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(invitations, "own_addresses", lambda wildcard: iter(["10.0.0.5", "10.1.0.5"]))
    port = everywhere.netloc.rpartition(":")[2]
    told = everywhere.get("/maps")
    assert (told["reach"], told["needs_token"], told["is_local"]) == ("network", True, False)
    base = f"http://10.0.0.5:{port}/maps/{FLIGHT}"
    assert told["addresses"]["xyz"] == f"{base}/{{z}}/{{x}}/{{y}}.png?token={TOKEN}"
    assert told["addresses"].keys() == set(NAMES)
    assert all(TOKEN in address for address in told["addresses"].values())
    monkeypatch.setattr(invitations, "own_addresses", lambda wildcard: iter([]))
    told = everywhere.get("/maps")
    assert (told["reach"], told["is_local"]) == ("nowhere", True)
    assert not any(TOKEN in address for address in told["addresses"].values())


def test_who_has_come_over_the_network_gets_the_address_that_worked(
    everywhere: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "is_loopback", lambda origin: False)
    port = everywhere.netloc.rpartition(":")[2]
    headers = {"Host": f"192.168.7.9:{port}", "Authorization": f"Bearer {TOKEN}"}
    _, told = everywhere.send("GET", "/maps", **headers)
    assert told["addresses"]["wms"] == f"http://192.168.7.9:{port}/maps/{FLIGHT}/wms?token={TOKEN}"
    assert everywhere.send("GET", "/maps")[0] == 401


def test_at_this_machine_alone_that_is_said(pinned: Writer, flight: AnchoredFlight) -> None:
    told = pinned.get("/maps")
    assert (told["reach"], told["needs_token"], told["is_local"], told["cors"]) == ("loopback", False, True, False)
    assert told["addresses"]["wms"] == f"http://{pinned.netloc}/maps/{FLIGHT}/wms"
    assert (told["over_underlay"], told["unanchored"]) == (None, [])
    assert told["bounds"] == pytest.approx(flight.laid.bounds, abs=1e-6)
    assert [one["island"] for one in told["islands"]] == [0]
    assert 0 < told["error_m"] < 1


def test_without_an_anchor_nothing_is_shown_and_the_islands_are_named(client: Writer) -> None:
    told = client.get("/maps")
    assert (told["islands"], told["unanchored"], told["error_m"], told["bounds"]) == ([], [0], None, None)


def test_a_code_holds_the_address(pinned: Writer) -> None:
    """As a camera reads it."""
    addresses = pinned.get("/maps")["addresses"]
    for name in ("xyz", "atak_import"):
        answer, data = pinned.ask(f"/api/v1/maps/codes/{name}.svg")
        assert answer.headers["Content-Type"].startswith("image/svg+xml")
        assert read_code(data) == addresses[name]
    assert pinned.status("/api/v1/maps/codes/everything.svg") == 404


def read_code(svg: bytes) -> str:
    """Drawn by its one path of horizontal strokes."""
    root = ElementTree.fromstring(svg)
    space = "{http://www.w3.org/2000/svg}"
    side = int(float(root.get("width", "0")))
    strokes = next(one.get("d", "") for one in root.iter(f"{space}path") if one.get("stroke"))
    image = np.full((side, side), 255, np.uint8)
    x = y = 0.0
    for command, numbers in commands(strokes):
        if command in "Mm":
            x, y = (numbers[0], numbers[1]) if command == "M" else (x + numbers[0], y + numbers[1])
        elif command == "h":
            left, right, top, bottom = (round(4 * at) for at in (x, x + numbers[0], y - 0.5, y + 0.5))
            image[top:bottom, left:right] = 0
            x += numbers[0]
    # Of one code in 140 OpenCV reads nothing at one size; a camera is moved until it reads.
    sizes = (cv2.resize(image, None, fx=by, fy=by, interpolation=cv2.INTER_LINEAR) for by in (1, 0.75, 1.5))
    return next((text for one in sizes if (text := cv2.QRCodeDetector().detectAndDecode(one)[0])), "")


def commands(path: str) -> Iterator[tuple[str, list[float]]]:

    for command, numbers in re.findall(r"([Mmh])([^Mmh]*)", path):
        yield command, [float(one) for one in re.findall(r"-?[\d.]+", numbers)]


@pytest.mark.parametrize(
    ("root", "is_refused"),
    [
        ("http://127.0.0.1:8470/", True),
        ("http://localhost:8470/", True),
        ("http://[::1]:8470/", True),
        ("http://169.254.3.4:8470/", True),
        ("http://192.168.1.5:8470/", False),
        ("http://laptop.local:8470/", False),
        ("https://10.0.0.5/", False),
    ],
)
def test_addresses_that_qgroundcontrol_refuses(root: str, is_refused: bool) -> None:
    assert is_refused_by_qgroundcontrol(root) == is_refused


@pytest.mark.long
def test_codes_are_made_without_loading_what_makes_them_before() -> None:

    code = "import sys, gcs_mosaic.web.page_process, gcs_mosaic.web.server; print('segno' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
