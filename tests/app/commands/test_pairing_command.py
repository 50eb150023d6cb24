"""`gcs-mosaic pair DIR`: all pictures a shot later, kept, and had back."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.app.commands.pairing import pair
from gcs_mosaic.app.inputs.pairing_check import contradiction
from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Position
from gcs_mosaic.store.folder import LEDGER_NAME, PAIRING_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.records import EventState, FlightRecord
from gcs_mosaic.triggers.shifted_positions import shift_by_positions
from tests.factories import frame, trigger_event

COUNT = 6


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Six shots, seven files, of which the first is a test shot: each pair is one off, and the last file has none."""
    with closing(Ledger(tmp_path / LEDGER_NAME)) as ledger:
        ledger.begin_flight(FlightRecord(name="f", started_utc=1.7e9))
        for k in range(COUNT + 1):
            ledger.record_frame(frame(f"{k}.jpg", 2.0 * k))
        for k in range(COUNT):
            event = ledger.record_event(trigger_event(k, 2.0 * k, position=_position(k)))
            ledger.settle_event(event, EventState.MATCHED, frame=f"{k}.jpg")
    return tmp_path


def _position(k: int) -> Position:
    return Position(latitude_deg=47.0 + 1e-4 * k, longitude_deg=8.0, altitude_m=None)


def pairs(flight: Path) -> list[str | None]:
    with closing(Ledger(flight / LEDGER_NAME, read_only=True)) as ledger:
        return [record.frame for record in ledger.events()]


AS_FOUND = [f"{k}.jpg" for k in range(COUNT)]


def test_each_picture_belongs_a_shot_earlier_and_the_last_one_is_found(flight: Path) -> None:
    assert "6 of 6 triggers have a picture, 1 pictures have no trigger; each picture 1 shot earlier" in pair(flight, -1)
    assert pairs(flight) == [f"{k + 1}.jpg" for k in range(COUNT)]


def test_a_shot_later_leaves_the_first_shot_without(flight: Path) -> None:
    pair(flight, 1)
    assert pairs(flight) == [None, *AS_FOUND[:-1]]


@pytest.mark.parametrize("back", ["0", "auto"])
def test_what_was_found_in_flight_can_be_had_back_after_any_number_of_shifts(flight: Path, back: str) -> None:
    for shift in ("1", "-2", "5", "-1"):
        assert main(["pair", str(flight), "--shift", shift]) == 0
    assert (flight / PAIRING_NAME).is_file()
    assert main(["pair", str(flight), "--shift", back]) == 0
    assert pairs(flight) == AS_FOUND
    assert not (flight / PAIRING_NAME).exists()


def test_a_shift_is_that_of_the_pairs_found_in_flight_not_of_the_last_choice(flight: Path) -> None:
    pair(flight, -1)
    pair(flight, -1)
    assert pairs(flight) == [f"{k + 1}.jpg" for k in range(COUNT)]


def test_a_shift_that_was_not_finished_is_finished_by_the_next(flight: Path) -> None:
    """Killed between the file and the ledger."""
    found = {str(k + 1): name for k, name in enumerate(AS_FOUND)}
    (flight / PAIRING_NAME).write_text(json.dumps({"shift": 1, "last_event": COUNT, "found": found}))
    pair(flight, 0)
    assert pairs(flight) == AS_FOUND


def test_a_flight_that_is_being_written_is_not_touched(flight: Path) -> None:
    lock = try_lock(flight)
    assert lock is not None
    with pytest.raises(UsageError, match="is being written by another gcs-mosaic"):
        pair(flight, 1)
    lock.release()
    assert pairs(flight) == AS_FOUND


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"shift": 1, "last_event": 2, "found": {"1": 5}}', "[" * 5000])
def test_what_somebody_else_has_put_there_is_refused(flight: Path, content: str) -> None:
    (flight / PAIRING_NAME).write_text(content)
    with pytest.raises(UsageError, match="is none that gcs-mosaic has written"):
        pair(flight, 1)
    assert pairs(flight) == AS_FOUND


def test_a_link_is_not_followed(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other") / "x.json"
    other.write_text("{}")
    (flight / PAIRING_NAME).symlink_to(other)
    with pytest.raises(UsageError, match="is none that gcs-mosaic has written"):
        pair(flight, 1)
    assert other.read_text() == "{}"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("none",), "does not exist"),
        ((".", "--shift", "x"), "x is no number of shots"),
        ((".", "--shift", "5000"), "more than"),
    ],
)
def test_what_cannot_be_paired_is_told_in_one_sentence(
    flight: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(flight)
    assert main(["pair", *words]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def lawnmower() -> list[complex]:
    """Places of 30 shots in three lines, in metres, y down."""
    lines = [[complex(20 * k, 0) for k in range(10)], [complex(180, 40)] * 0, []]
    lines[1] = [complex(180 - 20 * k, 40) for k in range(10)]
    lines[2] = [complex(20 * k, 80) for k in range(10)]
    return [place for line in lines for place in line]


@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_positions_tell_by_how_many_shots_the_pictures_are_off(shift: int) -> None:
    there = lawnmower()
    told = [(47.0 - place.imag / 111_320, 8.0 + place.real / 111_320 / 0.6820) for place in there]
    turned = [place * (0.4 + 0.3j) + 7 for place in there]
    seen = [turned[k + shift] if 0 <= k + shift < 30 else None for k in range(30)]
    assert shift_by_positions(told, seen) == shift


def test_positions_of_a_straight_line_tell_nothing() -> None:
    told = [(47.0, 8.0 + 1e-4 * k) for k in range(20)]
    assert shift_by_positions(told, [complex(k, 0) for k in range(20)]) is None
    assert shift_by_positions([None] * 20, [None] * 20) is None


def test_a_flight_without_a_map_is_not_contradicted(flight: Path) -> None:
    with closing(Ledger(flight / LEDGER_NAME, read_only=True)) as ledger:
        assert contradiction(ledger) is None
