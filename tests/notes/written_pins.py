"""Pins written into a flight's notes, without its page."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

from gcs_mosaic.notes.anchors.pins import NewPin, Pins
from gcs_mosaic.notes.ground.binding import Binding
from gcs_mosaic.notes.storage.book import NotesBook


def write_pins(root: Path, pins: Iterable[tuple[float, float, float, float]]) -> None:
    """Each (x, y) of island 0 has this longitude and latitude, within 5 cm."""
    with closing(NotesBook(root)) as book:
        for x, y, longitude, latitude in pins:
            binding = Binding(island=0, x=x, y=y, frame=None, pixel=None)
            place = {"longitude_deg": longitude, "latitude_deg": latitude, "sigma_m": 0.05}
            Pins(book).create(NewPin(label="", written="", who="Kim", binding=binding, **place))
