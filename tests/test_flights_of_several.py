"""Two simulated aircraft over one ground against the real daemon: real MAVLink over UDP, real files, one map."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests import documents
from tests.test_flights import fly
from tests.tiers import THOROUGH

COUNT = 14
pytestmark = THOROUGH


@pytest.mark.parametrize("links", ["one", "each"])
def test_two_aircraft_over_one_ground_make_one_map(tmp_path: Path, links: str) -> None:
    """Two system ids on one link, and a link for each; both cameras write the same names."""
    flown = fly(tmp_path, "--aircraft", "2", "--links", links, "--manner", "px4,camera", "--count", str(COUNT))
    assert flown.score.unknown == ()
    assert flown.score.placed == COUNT
    assert flown.score.islands == 1
    assert flown.score.ortho_worst_frame < 1
    assert flown.closes(frames=COUNT)
    assert [link["counted"] for link in flown.status["mavlink"]] == [[1, 2]] * (1 if links == "one" else 2)
    of_each = {one["system"]: one for one in flown.status["aircraft"]}
    assert {system: one["frames"]["placed"] for system, one in of_each.items()} == {1: COUNT // 2, 2: COUNT // 2}
    assert {system: one["events"]["matched"] for system, one in of_each.items()} == {1: COUNT // 2, 2: COUNT // 2}
    with Ledger(flown.out / LEDGER_NAME, read_only=True) as ledger:
        for record in ledger.events():
            assert record.frame is None or record.frame.startswith(f"{record.event.vehicle}/")
    placed = documents.placements(flown.out)
    assert {(entry["vehicle"], entry["camera"]) for entry in placed["frames"]} in ({(1, 0), (2, 1)}, {(1, 1), (2, 0)})
