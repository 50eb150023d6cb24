"""One file for the debriefing, and a find in a message."""

from __future__ import annotations

import re
from contextlib import closing
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.handover.message import as_message, crop_of_find
from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.finds.export_finds import finds_in
from gcs_mosaic.notes.finds.finds import Finds, NewFind, PlacedFind, placed
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.views.flight_view import FlightView
from tests.handover.gapped import PLANE, gapped_flight

EVIL = "<script>alert(1)</script>"


def with_find(root: Path) -> Path:
    with closing(NotesBook(root)) as book:
        binding = GroundFollower(FlightView(root)).bound(0, 30.0, 20.0)
        Finds(book).create(
            NewFind(kind="person", label=EVIL, note="by the tree", who="Kim", in_original=False, binding=binding)
        )
    return root


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    return with_find(gapped_flight(tmp_path / "flight"))


def find_of(flight: Path) -> PlacedFind:
    view = FlightView(flight)
    (one,) = placed(finds_in(flight), GroundFollower(view), anchor_of(anchors_of(view)))
    return one


class Addresses(HTMLParser):
    """Of all that a page would load, or run."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.loaded += [tag] if tag in ("script", "iframe", "object", "embed", "link") else []
        for name, value in attributes:
            self.loaded += [value or ""] if name in ("src", "href", "srcset", "action", "style") else []
            self.loaded += [name] if name.startswith("on") else []


def test_it_tells_all_and_needs_no_network(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(flight), "--format", "debriefing"]) == 0
    assert "1 find, the map and what was not seen written to" in capsys.readouterr().out
    page = (flight / "debriefing.html").read_text()
    addresses = Addresses()
    addresses.feed(page)
    assert all(one.startswith("data:image/jpeg;base64,") for one in addresses.loaded)
    assert "<title>gapped: debriefing</title>" in page
    assert "&lt;script&gt;" in page
    assert len(re.findall("<polygon ", page)) == 1
    (way,) = re.findall(r'<g class="way"><polyline points="([^"]+)"', page)
    assert len(way.split()) == 36
    area = re.search(r"inside of it not seen</th><td>(\d+) m²", page)
    assert area is not None
    assert float(area[1]) == pytest.approx(20 * 6, rel=0.3)  # within the cells' size
    assert "1970-01-01T00:16:40Z to 1970-01-01T00:17:15Z" in page
    assert page.count("within 1 m") >= 2, "of the gap and of the find"


def test_without_an_anchor_it_says_so(tmp_path: Path) -> None:
    flight = with_find(gapped_flight(tmp_path / "flight", pinned=False))
    assert main(["export", str(flight), "--format", "debriefing"]) == 0
    page = (flight / "debriefing.html").read_text()
    assert "not known: the island has no anchor" in page
    assert "million pixels" in page
    assert "The map has no anchor yet" in page


def test_a_find_is_a_message_that_a_telephone_opens(flight: Path) -> None:
    lines = as_message(find_of(flight), "gapped", FlightView(flight)).splitlines()
    longitude, latitude = PLANE.places(np.array([3.0, -2.0])).tolist()
    assert lines[0] == f"Find 1 of gapped - person - {EVIL}"
    assert lines[1] == f"{latitude:.6f}, {longitude:.6f} (within 1 m)"
    assert lines[2] == f"geo:{latitude:.6f},{longitude:.6f};u=1"
    assert lines[3] == "by the tree"
    assert re.fullmatch(r"in 0\.jpg, came 1970-01-01T00:16:40Z by its file", lines[4])
    assert lines[5].startswith("marked by Kim, ")


def test_a_find_whose_original_is_gone_has_no_picture_but_is_told(flight: Path, tmp_path: Path) -> None:
    assert crop_of_find(find_of(flight), FlightView(flight)) is None
    unlaid = with_find(gapped_flight(tmp_path / "unlaid", pinned=False))
    assert "island 0, canvas 30, 20. The map has no anchor yet" in as_message(find_of(unlaid), "f", FlightView(unlaid))
