"""In the report of a find stands what all looks at it show at the ground, where there are two looks or more."""

from __future__ import annotations

import base64
import re
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.notes.finds.finds import Finds, NewFind
from gcs_mosaic.notes.finds.report import CROP
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.views.flight_view import FlightView
from tests.ended_flights import ended_flight

pytestmark = pytest.mark.long


def places_by_looks(root: Path) -> dict[int, tuple[float, float]]:
    """For a number of frames a place that so many see, clear of their borders."""
    table, found = FlightView(root).table(), dict[int, tuple[float, float]]()
    low, high = np.nanmin(table.boxes[:, :2], axis=0), np.nanmax(table.boxes[:, 2:], axis=0)
    for x in np.linspace(low[0], high[0], 40):
        for y in np.linspace(low[1], high[1], 40):
            inside = [cv2.pointPolygonTest(one.astype(np.float32), (x, y), True) for one in table.outlines]
            if min(map(abs, inside)) > 15:
                found.setdefault(sum(one > 0 for one in inside), (float(x), float(y)))
    return found


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """With a find that one frame sees, and another one that three or more do."""
    folder = tmp_path_factory.mktemp("beneath")
    root = ended_flight(folder / "flight", world_cache)
    places = places_by_looks(root)
    with closing(NotesBook(root)) as book:
        for label, place in {"alone": places[1], "often": places[max(places)]}.items():
            binding = GroundFollower(FlightView(root)).bound(0, *place)
            Finds(book).create(
                NewFind(kind="person", label=label, note="", who="Kim", in_original=False, binding=binding)
            )
    return root


@pytest.mark.parametrize("kind", ["finds-report", "debriefing"])
def test_a_find_of_many_looks_has_them_laid_together(flight: Path, tmp_path: Path, kind: str) -> None:
    target = tmp_path / "report.html"
    assert main(["export", str(flight), "--format", kind, "--to", str(target)]) in (0, None)
    alone, often = (card for card in target.read_text().split("<article>")[1:])
    assert "alone" in alone
    assert "looks laid together" not in alone
    (looks,) = re.findall(r"<figcaption>(\d+) looks laid together, in focus at the ground</figcaption>", often)
    assert int(looks) >= 3
    crop, integral = (base64.b64decode(one) for one in re.findall(r'jpeg;base64,([^"]+)"', often))
    images = [cv2.imdecode(np.frombuffer(one, np.uint8), cv2.IMREAD_COLOR) for one in (crop, integral)]
    assert all(one is not None for one in images)
    assert images[1] is not None
    assert images[1].shape[:2] == (CROP, CROP)
