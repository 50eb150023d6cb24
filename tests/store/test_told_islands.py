"""Islands as a document tells them, whoever wrote it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.told_islands import checked_islands, told_islands

ISLAND: dict[str, Any] = {"id": 0, "bounds": [-5.0, -4, 5, 4.0], "minzoom": 0, "maxzoom": 3, "frames": 2}


@pytest.mark.parametrize(
    "change",
    [
        {"bounds": [-5, -4, 5]},
        {"bounds": "abcd"},
        {"bounds": [6, -4, 5, 4]},
        {"bounds": [-5, 5, 5, 4]},
        {"bounds": [-5, -4, float("nan"), 4]},
        {"bounds": [-5, -4, 1e300, 4]},
        {"bounds": [True, 1, 5, 4]},
        {"bounds": [None, 1, 5, 4]},
        {"id": -1},
        {"id": 10**9 + 1},
        {"id": True},
        {"id": "0"},
        {"frames": -1},
        {"frames": 1.5},
        {"minzoom": -1},
        {"maxzoom": 1000},
        {"maxzoom": None},
        {"merged_into": -1},
        {"merged_into": "0"},
    ],
    ids=str,
)
def test_numbers_that_no_island_has_are_refused(change: dict[str, Any], tmp_path: Path) -> None:
    document = {"format": 1, "islands": [ISLAND, ISLAND | change]}
    with pytest.raises(ValueError, match="numbers that no island has"):
        checked_islands(document)
    (tmp_path / "mosaic.json").write_text(json.dumps(document))
    with pytest.raises(UsageError, match="not a map that this gcs-mosaic can read"):
        told_islands(tmp_path)


@pytest.mark.parametrize(
    "change",
    [{"merged_into": None}, {"merged_into": 0}, {"id": 10**9}, {"bounds": [1, 2, 1, 2]}, {"frames": 0}],
    ids=str,
)
def test_what_an_island_may_have_is_not(change: dict[str, Any], tmp_path: Path) -> None:
    document = {"format": 1, "islands": [ISLAND | change]}
    (tmp_path / "mosaic.json").write_text(json.dumps(document))
    assert told_islands(tmp_path) == document["islands"]


@pytest.mark.parametrize("islands", [None, {}, [1], "x"])
def test_islands_are_a_list_of_objects(islands: object) -> None:
    with pytest.raises(ValueError, match="no list of objects"):
        checked_islands({"islands": islands})


def test_a_flight_that_ended_before_its_first_frame_has_no_islands(tmp_path: Path) -> None:
    assert told_islands(tmp_path) == []
