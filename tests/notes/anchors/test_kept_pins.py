"""How many pins are kept."""

from __future__ import annotations

import pytest

from gcs_mosaic.notes.anchors import pins as of_pins
from gcs_mosaic.notes.anchors.pins import NewPin, Pins, SetPin
from gcs_mosaic.notes.ground.binding import Binding
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit


def made(pins: Pins) -> SetPin:
    binding = Binding(island=0, x=0.0, y=0.0)
    place = {"longitude_deg": 7.5, "latitude_deg": 47.5, "sigma_m": 3.0}
    return pins.create(NewPin(label="", written="", who="Kim", binding=binding, **place))


def test_deleted_pins_take_no_place_of_others(book: NotesBook, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_pins, "MOST_PINS", 3)
    monkeypatch.setattr(of_pins, "MOST_DELETED", 2)
    pins = Pins(book)
    kept = [made(pins) for _ in range(2)]
    deleted = [pins.set_deleted(made(pins).id, deleted=True) for _ in range(10)]
    assert pins.all() == kept
    assert pins.get(deleted[-1].id).deleted
    assert len(pins.all(deleted=True)) < len(kept) + len(deleted), "those deleted long ago are let go"
    kept.append(made(pins))
    with pytest.raises(Unfit, match="pins were set already"):
        made(pins)
    pins.set_deleted(kept[0].id, deleted=True)
    pins.set_deleted(kept[0].id, deleted=False)  # an old one can be brought back as well
    assert pins.all() == kept
