"""Finds for other programs: nothing made up, nothing that does harm there."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
from codecs import BOM_UTF8
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from gcs_mosaic.cli import main as cli
from gcs_mosaic.notes.anchors.scales import KnownDistance, island_scales, metres_per_unit
from gcs_mosaic.notes.finds.exports import NO_ANCHOR, as_csv, as_geojson, as_kml
from gcs_mosaic.notes.finds.finds import Find, Finds, NewFind, PlacedFind, placed
from gcs_mosaic.notes.finds.report import as_report
from gcs_mosaic.notes.ground.binding import Binding, GroundFollower, GroundPlace
from gcs_mosaic.notes.ground.places import GeoPlace
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit, number_of, text_of
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.views.flight_view import FlightView
from tests.sure import sure
from tests.web.small_flight import GREEN, MIDDLE, SmallFlight

EVIL = '=HYPERLINK("http://x") <script>alert(1)</script> & \'"'
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture
def one() -> PlacedFind:
    binding = Binding(island=0, x=1.5, y=2.5, frame="a\udcff\n.jpg", pixel=(3.0, 4.0))
    texts = {"kind": "person", "label": EVIL, "note": "-1+1", "who": "@Kim", "changed_by": "+Lou"}
    find = Find(
        id=7, revision=1, deleted=False, created_utc=0.0, changed_utc=1.0, in_original=False, binding=binding, **texts
    )
    return PlacedFind(find, GroundPlace(island=0, x=1.5, y=2.5, number=1), None)


def test_geojson_invents_no_longitude(one: PlacedFind) -> None:
    told = json.loads(as_geojson([one], "f"))
    feature = told["features"][0]
    assert (told["comment"], feature["geometry"]) == (NO_ANCHOR, None)
    assert feature["properties"]["canvas"] == {"island": 0, "x": 1.5, "y": 2.5}
    anchored = json.loads(as_geojson([replace(one, geo=GeoPlace(11.5, 48.1, 3.0))], "f"))
    assert "comment" not in anchored
    assert anchored["features"][0]["geometry"] == {"type": "Point", "coordinates": [11.5, 48.1]}
    assert anchored["features"][0]["properties"]["error_m"] == 3.0


def test_a_spreadsheet_computes_nothing(one: PlacedFind) -> None:
    row = next(csv.DictReader(io.StringIO(as_csv([one]))))
    assert [row[name][:2] for name in ("label", "note", "who", "changed_by")] == ["'=", "'-", "'@", "'+"]
    assert row["label"].endswith(EVIL)
    assert (row["canvas_x"], row["longitude"]) == ("1.5", "")


@pytest.mark.parametrize("letter", ["\uffff", "\ufffe", "\x00", "\x1b", "\ud800"])
def test_no_letter_of_a_note_spoils_the_file_for_all_others(one: PlacedFind, letter: str) -> None:
    find = replace(one.find, label=f"a{letter}b \u20ac \U0001f6d1\n\tc", note=letter, kind=letter)
    root = ElementTree.fromstring(as_kml([replace(one, find=find), one], "f").encode())
    names = [mark.findtext(f"{KML}name") for mark in root.iter(f"{KML}Placemark")]
    assert names == ["a\ufffdb \u20ac \U0001f6d1\n\tc", EVIL]


def test_kml_is_well_formed_and_says_that_there_is_no_anchor(one: PlacedFind) -> None:
    root = ElementTree.fromstring(as_kml([one], "f<&"))
    mark = next(root.iter(f"{KML}Placemark"))
    assert next(root.iter(f"{KML}description")).text == NO_ANCHOR
    assert [found.text for found in mark.iter(f"{KML}name")] == [EVIL]
    assert list(mark.iter(f"{KML}Point")) == []
    there = ElementTree.fromstring(as_kml([replace(one, geo=GeoPlace(11.5, 48.1, 3.0))], "f"))
    assert [found.text for found in there.iter(f"{KML}coordinates")] == ["11.5,48.1"]


def test_the_report_runs_and_loads_nothing(one: PlacedFind, view: FlightView) -> None:
    page = as_report([one], "<b>", view, 0.0)
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert NO_ANCHOR in page
    assert "http://x" in page  # as text only
    assert "src=" not in page.replace('src="data:', "")


def test_a_flight_is_exported_by_command(
    flight_with_find: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for kind, begins in {"geojson": "{", "csv": "id,", "kml": "<?xml", "report": "<!doctype"}.items():
        target = tmp_path / kind
        assert cli.main(["export", str(flight_with_find), "--format", f"finds-{kind}", "--to", str(target)]) in (
            0,
            None,
        )
        assert target.read_text("utf-8-sig").startswith(begins)
        assert target.read_bytes().startswith(BOM_UTF8) is (kind == "csv")  # by which Excel knows umlauts
        assert "tent" in target.read_text()
    said = capsys.readouterr().out.splitlines()
    assert [line for line in said if line.startswith("1 find written to ")] == said[::2]
    assert all(line.startswith(f"warning: {NO_ANCHOR} Two pins") for line in said[1::2])


def test_one_find_without_an_anchor_is_told_among_others(one: PlacedFind) -> None:
    two = [one, replace(one, geo=GeoPlace(11.5, 48.1, 3.0))]
    comment = json.loads(as_geojson(two, "f"))["comment"]
    assert comment.startswith("1 find on islands without an anchor")
    assert "comment" not in json.loads(as_geojson([], "f"))


def test_the_report_shows_where_on_the_map_a_find_lies(one: PlacedFind, tmp_path: Path) -> None:
    small = SmallFlight(tmp_path)
    small.paint(Tile(16, MIDDLE, MIDDLE), GREEN)
    small.write()
    page = as_report(
        [replace(one, place=GroundPlace(island=0, x=127.5, y=255.5, number=None))], "f", FlightView(tmp_path), 0.0
    )
    assert "<title>f: 1 find</title>" in page
    circle = re.search(r'<circle cx="([0-9.]+)" cy="([0-9.]+)"', page)
    assert circle is not None
    assert tuple(map(float, circle.groups())) == (128.0, 256.0)
    data = re.search(r'class="map"><img [^>]*base64,([^"]+)"', page)
    assert data is not None
    image = sure(cv2.imdecode(np.frombuffer(base64.b64decode(data[1]), np.uint8), cv2.IMREAD_COLOR))
    assert np.abs(image[64, 64].astype(int) - GREEN).max() < 10
    assert len(np.unique(image[400, 400])) == 1, "what nobody saw is grey"


@pytest.fixture
def flight_with_find(book: NotesBook, view: FlightView) -> Path:
    binding = GroundFollower(view).bound(0, 0.0, 0.0)
    new = NewFind(kind="tent", label="tent", note="", who="Kim", in_original=False, binding=binding)
    assert len(placed([Finds(book).create(new)], GroundFollower(view))) == 1
    return book.root


def test_the_length_of_a_canvas_unit() -> None:
    a, b = GroundPlace(island=0, x=0, y=0, number=1), GroundPlace(island=0, x=30, y=40, number=1)
    assert metres_per_unit(a, b, 10.0) == pytest.approx(0.2)
    assert metres_per_unit(a, replace(b, island=1), 10.0) is None
    assert metres_per_unit(a, replace(a, x=0.5), 10.0) is None


def test_the_newest_distance_on_an_island_counts() -> None:
    def known(number: int, metres: float, *, deleted: bool = False) -> KnownDistance:
        ends = (Binding(island=0, x=0, y=0), Binding(island=0, x=100, y=0))
        return KnownDistance(id=number, deleted=deleted, ends=ends, metres=metres, who="Kim", utc=0.0)

    def place(binding: Binding) -> GroundPlace:
        return GroundPlace(island=binding.island, x=binding.x, y=binding.y, number=None)

    scales = island_scales([known(1, 10.0), known(2, 20.0), known(3, 30.0, deleted=True)], place)
    assert scales[0].metres_per_unit == pytest.approx(0.2)
    assert scales[0].scale == 2


def test_what_is_typed_is_checked() -> None:
    assert text_of(" a\x00\x1b[31m\u202eb\n ", "t", 40) == "a[31mb"
    assert text_of("a\r\nb\tc\x07", "t", 40, lines=True) == "a\nb\tc"
    for unfit in (3, ["a"], "x" * 41):
        with pytest.raises(Unfit):
            text_of(unfit, "t", 40)
    with pytest.raises(Unfit):
        text_of("\x00 ", "t", 40, needed=True)
    for number in (True, "1", None, float("nan"), float("inf"), 10**400, 6):
        with pytest.raises(Unfit):
            number_of(number, "n", 0, 5)
