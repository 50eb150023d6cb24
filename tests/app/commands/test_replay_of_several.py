"""A recorded flight of two aircraft is flown again, with the frames of each in a folder of its own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.mavlink.tlog import TIME
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests import documents
from tests.mavlink.mavlink_peer import captured, heartbeat, packet
from tests.running import frames_of
from tests.tiers import thorough

BEGAN = 1.75e9
LONG_AGO = 1.6e9  # seconds since 1970: copies have lost their times
FIRST_COUNT = {1: 1, 2: 40}  # the cameras' counters


@pytest.fixture
def flown(tmp_path: Path, pictures: list[bytes], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with flight.tlog, in which two aircraft take three pictures each in turn, and with north and south, in which
    both cameras have used the same names."""
    for k, picture in enumerate(pictures):
        folder = tmp_path / ("north", "south")[k % 2] / "DCIM"
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"IMG_{k // 2}.JPG"
        path.write_bytes(picture)
        os.utime(path, (LONG_AGO, LONG_AGO))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(flown: Path, *, named: bool) -> None:
    """What both said of their pictures; without names the counters tell."""
    said = [(0.0, packet(heartbeat(), system=system)) for system in (1, 2)]
    for k in range(6):
        system, shot = 1 + k % 2, k // 2
        url = f"IMG_{shot}.JPG".encode() if named else b""
        told = captured(FIRST_COUNT[system] + shot, file_url=url)
        said.append((1.0 + 2 * k, packet(told, system=system)))
    (flown / "flight.tlog").write_bytes(b"".join(TIME.pack(int((BEGAN + at) * 1e6)) + data for at, data in said))


def replayed(flown: Path, *words: str) -> Path:
    assert main(["replay", "flight.tlog", *words, "--out", "mosaic"]) == 0
    return flown / "mosaic"


def matched(out: Path) -> list[tuple[int, str | None]]:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return [(record.event.vehicle, record.frame) for record in ledger.events()]


@pytest.mark.long
@pytest.mark.parametrize("named", [thorough(True, id="by names"), pytest.param(False, id="by counters")])
def test_each_aircraft_s_triggers_are_paired_with_its_own_frames(
    flown: Path, capsys: pytest.CaptureFixture[str], named: bool
) -> None:
    record(flown, named=named)
    out = replayed(flown, "--frames", "1=north", "--frames", "2=south")
    assert matched(out) == [(1 + k % 2, f"{1 + k % 2}/DCIM/IMG_{k // 2}.JPG") for k in range(6)]
    assert {name: frame.vehicle for name, frame in frames_of(out).items()} == {
        f"{system}/DCIM/IMG_{shot}.JPG": system for system in (1, 2) for shot in range(3)
    }
    placed = documents.placements(out)
    assert {entry["island"] for entry in placed["frames"]} == {placed["frames"][0]["island"]}
    assert len(placed["cameras"]) == 2  # a lens of each
    told = "the file names in the camera messages" if named else "the numbers in the file names"
    said = " ".join(capsys.readouterr().out.split())
    assert f"3 files of aircraft 1, which came as told by {told}; 3 files of aircraft 2, which came" in said


@pytest.mark.long
def test_with_one_folder_the_triggers_of_all_count_if_that_is_asked_for(flown: Path) -> None:
    record(flown, named=False)
    out = replayed(flown, "--frames", "north", "--vehicles", "all")
    assert [vehicle for vehicle, _ in matched(out)] == [1, 2, 1, 2, 1, 2]
    assert {frame.vehicle for frame in frames_of(out).values()} == {None}


@pytest.mark.long
def test_one_of_several_is_followed_if_that_is_asked_for(flown: Path) -> None:
    record(flown, named=True)
    out = replayed(flown, "--frames", "south", "--vehicle", "2")
    assert matched(out) == [(2, f"DCIM/IMG_{shot}.JPG") for shot in range(3)]


@pytest.mark.long
def test_a_folder_on_the_command_line_is_for_all_whatever_the_settings_say(flown: Path) -> None:
    record(flown, named=True)
    (flown / "settings.yaml").write_text("sources: [{vehicle: 1, watch: north}, {vehicle: 2, watch: south}]\n")
    out = replayed(flown, "--frames", "north", "--vehicle", "1", "--config", "settings.yaml")
    assert matched(out) == [(1, f"DCIM/IMG_{shot}.JPG") for shot in range(3)]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("1=north", "south"), "--frames south names no aircraft, others do: name that of each, as in --frames 1=DIR"),
        (("1=north", "2=north/DCIM"), "give each a folder of its own, none inside another"),
        (("1=north", "1=south"), "aircraft 1 was given more than one folder or stream"),
        (
            ("north", "south"),
            "--frames was given more than once: for several aircraft name each, as in --frames 1=north",
        ),
        (("1=north", "2=none"), "'none' cannot be read (No such file or directory): give"),
        (("1=north", "256=south"), "--frames: vehicle: expected a MAVLink system id from 1 to 255, got 256"),
    ],
)
def test_what_is_no_folder_of_each_is_told_in_one_sentence(
    flown: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    record(flown, named=True)
    given = [word for folder in words for word in ("--frames", folder)]
    assert main(["replay", "flight.tlog", *given, "--out", "mosaic"]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (flown / "mosaic").exists()
