"""Notes of flights that were merged: on the frames that they were set on, wherever these lie now."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.notes.anchors.pins import NewPin, Pins
from gcs_mosaic.notes.anchors.scales import Scales
from gcs_mosaic.notes.finds.finds import Find, Finds, NewFind
from gcs_mosaic.notes.ground.binding import Binding
from gcs_mosaic.notes.merged_notes import NotedFlight, merge_notes
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import NOTES_NAME
from tests.notes.mapped import MappedFlight

PIXEL = (200.0, 150.0)


def on(frame: str | None, pixel: tuple[float, float] = PIXEL) -> Binding:
    return Binding(island=7, x=-1.0, y=-2.0, frame=frame, pixel=pixel if frame else None)


@pytest.fixture
def noted(tmp_path: Path) -> NotedFlight:
    """A flight whose frame `a` is called a.jpg on the map, and `gone` is not on it."""
    root = tmp_path / "noted"
    root.mkdir()
    with closing(NotesBook(root)) as book:
        finds, pins = Finds(book), Pins(book)
        for frame in ("a", "gone", None):
            words = {"kind": "person", "label": "red jacket", "note": "waves"}
            finds.create(NewFind(who="Kim", in_original=False, binding=on(frame), key=f"key of {frame}", **words))
        deleted = finds.create(NewFind(kind="", label="", note="", who="Kim", in_original=False, binding=on("a")))
        finds.delete(deleted.id, deleted.revision, "Kim")
        place = {"longitude_deg": 7.5, "latitude_deg": 47.5, "sigma_m": 3.0}
        pins.create(NewPin(label="mast", written="47.5 7.5", who="Kim", binding=on("a"), **place))
        pins.ask_for_positions("Kim", asked=True)
        Scales(book).create((on("a", (100.0, 100.0)), on("a", (200.0, 100.0))), 12.0, "Kim")
        Scales(book).create((on("a"), on("gone")), 12.0, "Kim")
    return NotedFlight(root, lambda name: f"{name}.jpg")


def finds_of(root: Path) -> list[Find]:
    with closing(NotesBook(root)) as book:
        return Finds(book).all(deleted=True)


def test_what_lies_on_a_frame_of_the_map_is_taken_along(flight: MappedFlight, noted: NotedFlight) -> None:
    said = [notice.text for notice in merge_notes(flight.root, [noted, NotedFlight(flight.root / "none", str)])]
    assert said == [
        f"{noted.path}: 1 find, 1 pin, 1 known distance taken along",
        f"{noted.path}: 2 finds, 1 known distance left there, on frames without a place on this map",
    ]
    (find,) = finds_of(flight.root)
    was = finds_of(noted.path)[0]
    assert (find.label, find.note, find.who, find.created_utc) == ("red jacket", "waves", "Kim", was.created_utc)
    assert (find.binding.island, find.binding.frame, find.binding.pixel) == (0, "a.jpg", PIXEL)
    assert abs(find.binding.x) < 300 > abs(find.binding.y)
    with closing(NotesBook(flight.root)) as book:
        (pin,), (distance,) = Pins(book).all(), Scales(book).all()
        assert (pin.pin.label, pin.pin.longitude_deg, pin.pin.binding.frame) == ("mast", 7.5, "a.jpg")
        assert Pins(book).asked_for_positions
        assert [(end.frame, end.pixel) for end in distance.ends] == [
            ("a.jpg", (100.0, 100.0)),
            ("a.jpg", (200.0, 100.0)),
        ]


def test_notes_of_one_flight_after_those_of_another(flight: MappedFlight, noted: NotedFlight) -> None:
    list(merge_notes(flight.root, [noted, NotedFlight(noted.path, lambda name: f"{name}.jpg")]))
    first, second = finds_of(flight.root)
    assert first.id != second.id


def test_notes_that_cannot_be_read_are_told_and_others_are_taken(
    flight: MappedFlight, noted: NotedFlight, tmp_path: Path
) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / NOTES_NAME).write_bytes(b"no notes at all, but as long as a page " * 200)
    said = list(merge_notes(flight.root, [NotedFlight(broken, str), noted]))
    assert said[0].level == "warning"
    assert "its notes were not taken along" in said[0].text
    assert len(finds_of(flight.root)) == 1


def test_a_flight_is_taken_along_whole_or_not_at_all(flight: MappedFlight, noted: NotedFlight) -> None:
    with closing(sqlite3.connect(noted.path / NOTES_NAME)) as file, file:
        file.execute("UPDATE scale_ends SET pixel_x = 'wide', pixel_y = 'high'")
    (said,) = merge_notes(flight.root, [noted])
    assert "its notes were not taken along" in said.text
    assert finds_of(flight.root) == []


def test_notes_of_an_earlier_version_have_no_pins(flight: MappedFlight, noted: NotedFlight) -> None:
    with closing(sqlite3.connect(noted.path / NOTES_NAME)) as file, file:
        file.executescript("DROP TABLE pins; DROP TABLE anchoring; PRAGMA user_version = 1")
    said = [notice.text for notice in merge_notes(flight.root, [noted])]
    assert said[0] == f"{noted.path}: 1 find, 1 known distance taken along"
