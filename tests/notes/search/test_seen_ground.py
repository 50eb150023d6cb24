"""The ground of an island that is shared out to be looked at."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_mosaic.notes.search import seen_ground as module
from gcs_mosaic.notes.search.seen_ground import CELL, COUNT, IslandGround, island_box, seen_cells, spans
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.views.flight_view import FlightView
from tests.notes.mapped import MappedFlight

NEAR_HORIZON = 1.26  # of pitch: the upper edge lies some tens of flying heights away
OVER_HORIZON = 1.4


def test_a_frame_near_the_horizon_does_not_make_the_island_too_large(flight: MappedFlight, view: FlightView) -> None:
    flight.paint("c.jpg", Pose(0.0, 0.0, pitch=NEAR_HORIZON))
    table = view.table()
    sizes = table.boxes[:, 2:] - table.boxes[:, :2]
    assert sizes[2].min() > 30 * np.nanmin(sizes), "no frame of this test sees far"
    box = island_box(table, 0)
    assert box is not None
    columns, lines = spans(box)
    assert len(columns) * len(lines) < 5000


def test_an_island_of_any_size_is_shared_out(
    flight: MappedFlight, view: FlightView, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More cells than one question may have; of one beyond that, the middle."""
    flight.paint("b.jpg", Pose(CELL * 1000, CELL * 1000))
    whole = IslandGround().of(view.table(), 0, math.inf)
    assert np.count_nonzero(whole.stamps) >= 2 * 9
    assert not whole.is_cut
    monkeypatch.setattr(module, "MOST_GROUND", 1 << 16)
    middle = IslandGround().of(view.table(), 0, math.inf)
    assert middle.stamps.size <= 1 << 16
    assert middle.is_cut


def test_ground_beyond_a_frames_reach_is_told_of(flight: MappedFlight, view: FlightView) -> None:
    """From much higher than the others, too: it is in no patch, so the island is never looked at whole."""
    assert not IslandGround().of(view.table(), 0, math.inf).is_cut
    flight.paint("b.jpg", Pose(0.0, 0.0, log_gsd=math.log(100.0)))
    flight.paint("c.jpg", Pose(100.0, 0.0))
    assert IslandGround().of(view.table(), 0, math.inf).is_cut


def test_few_islands_are_kept(flight: MappedFlight, view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that were asked for last: there are as many as there are flights' pieces."""
    monkeypatch.setattr(module, "KEPT_ISLANDS", 1)
    table, grounds = view.table(), IslandGround()
    first = grounds.of(table, 0, math.inf)
    assert grounds.of(table, 0, math.inf) is first
    grounds.of(table, 1, math.inf)
    again = grounds.of(table, 0, math.inf)
    assert again is not first
    assert (again.stamps == first.stamps).all()


def test_what_a_frame_over_the_horizon_shows_of_the_ground_is_there(flight: MappedFlight, view: FlightView) -> None:
    flight.paint("c.jpg", Pose(0.0, 0.0, pitch=OVER_HORIZON), island=1)
    table = view.table()
    outline = table.outlines[2]
    assert np.isnan(outline).any()
    assert np.isfinite(outline).any()
    box = island_box(table, 1)
    assert box is not None
    assert len(seen_cells(table, 1, box)) > 4


def test_a_frame_counts_once_it_was_known_for_a_while(flight: MappedFlight, view: FlightView) -> None:
    grounds = IslandGround()
    before = grounds.of(view.table(), 1, 0.0)
    flight.paint("b.jpg", Pose(0.0, 0.0), island=1)
    table = view.table()
    known = float(table.since[np.isfinite(table.since)][0])
    assert np.array_equal(grounds.of(table, 1, known - 1).stamps > 0, before.stamps > 0)
    assert (grounds.of(table, 1, known).stamps // COUNT).max() == 2
    assert grounds.of(table, 1, known) is grounds.of(table, 1, known + 1)


def test_of_an_island_that_there_is_not_nothing_is_known(view: FlightView) -> None:
    assert IslandGround().of(view.table(), 77, math.inf).stamps.size == 0
