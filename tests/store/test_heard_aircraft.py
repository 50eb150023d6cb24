"""Which aircraft a running flight has heard, and following another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import aircraft
from gcs_mosaic.store.aircraft import aircraft_lines, follow, heard_aircraft, running_flight
from gcs_mosaic.store.requests import Answer


def heard(system: int, described: str, last_heard: str | None) -> dict[str, Any]:
    return {"system": system, "described": described, "last_heard": last_heard}


def status(folder: Path, state: str, *links: dict[str, Any], updated: str = "2024-05-01T12:00:00.000Z") -> Path:
    folder.mkdir(exist_ok=True)
    document = {"state": state, "updated": updated, "mavlink": [*links]}
    (folder / "status.json").write_text(json.dumps(document))
    (folder / "mosaic.json").write_text("{}")
    return folder


NOW = 1714564800.0  # 2024-05-01T12:00:00Z


LINKS: list[dict[str, Any]] = [
    {"followed": 1, "aircraft": [heard(1, "ArduPilot", "2024-05-01T11:59:50.000Z"), heard(9, "", None)]},
    {"followed": None, "aircraft": [heard(1, "older", "2024-05-01T11:00:00.000Z"), heard(7, "PX4", "2024-05-01T12:00:05.000Z")]},
]  # fmt: skip


def test_each_aircraft_is_told_of_as_it_was_heard_last(tmp_path: Path) -> None:
    flight = status(tmp_path / "f", "flying", *LINKS)
    assert heard_aircraft(flight, NOW).splitlines() == [
        "system 1: followed, ArduPilot, heard 10 s ago",
        "system 7: PX4, heard 0 s ago",
        "system 9: of unknown kind, triggers a camera without a heartbeat",
    ]
    assert [*aircraft_lines({"mavlink": LINKS[::-1]}, NOW)] == heard_aircraft(flight, NOW).splitlines()
    assert "no aircraft has been heard" in heard_aircraft(status(tmp_path / "g", "flying"), NOW)


def test_the_flight_under_way_is_found_among_the_numbered_ones(tmp_path: Path) -> None:
    ended = status(tmp_path / "f", "stopped", updated="2024-05-01T13:00:00.000Z")
    with pytest.raises(UsageError, match="no flight is under way"):
        running_flight(ended)
    assert running_flight(ended, ended_too=True) == ended
    first = status(tmp_path / "f-2", "idle")
    later = status(tmp_path / "f-4", "flying", updated="2024-05-01T12:30:00.000Z")
    assert running_flight(ended) == later
    (first / "status.json").write_text("{")
    assert running_flight(ended) == later
    with pytest.raises(UsageError):
        running_flight(tmp_path / "none", ended_too=True)
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare/mosaic.json").write_text("{}")
    with pytest.raises(UsageError, match="has no status that can be read"):
        heard_aircraft(tmp_path / "bare")


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (None, "does not answer, so nothing was changed"),
        (
            Answer(id="x", taken=False, text="system 9 has not been heard"),
            "system 9 has not been heard: gcs-mosaic vehicle",
        ),
        (Answer(id="x", taken=True, text="system 9 is followed"), ""),
    ],
)
def test_what_a_flight_answers_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: Answer | None, error: str
) -> None:
    monkeypatch.setattr(aircraft, "ask_to_follow", lambda flight, vehicle, patience_s: told)
    flight = status(tmp_path / "f", "flying")
    if not error:
        assert follow(flight, 9) == "system 9 is followed"
        return
    with pytest.raises(UsageError, match=error):
        follow(flight, 9)
