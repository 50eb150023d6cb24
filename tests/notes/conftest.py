from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.views import flight_view
from gcs_mosaic.views.flight_view import FlightView
from tests.notes.mapped import MappedFlight


@pytest.fixture(autouse=True)
def _always_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Painted frames are read at each question."""
    monkeypatch.setattr(flight_view, "LEAST_REST_S", 0.0)
    monkeypatch.setattr(flight_view, "REST", 0.0)


@pytest.fixture
def flight(tmp_path: Path) -> MappedFlight:
    root = tmp_path / "flight"
    root.mkdir()
    return MappedFlight(root)


@pytest.fixture
def view(flight: MappedFlight) -> FlightView:
    return FlightView(flight.root)


@pytest.fixture
def book(flight: MappedFlight) -> Iterator[NotesBook]:
    made = NotesBook(flight.root)
    yield made
    made.close()
