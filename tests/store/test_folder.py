from __future__ import annotations

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.folder import (
    LEDGER_NAME,
    LONGEST_PATH,
    find_flight,
    occupied,
    open_flight_folder,
    refuse_watching_ourselves,
    resume_flight_folder,
)
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FlightRecord
from gcs_mosaic.store.schema import connect


def test_folder_is_made_and_said(tmp_path: Path) -> None:
    folder = open_flight_folder(tmp_path / "deep" / "mosaic")
    assert folder.path.is_dir()
    assert "was created" in folder.said
    folder.close()


def test_second_flight_goes_beside_the_first(tmp_path: Path) -> None:
    out = tmp_path / "mosaic"
    for expected in ("mosaic", "mosaic-2", "mosaic-3"):
        folder = open_flight_folder(out)
        (folder.path / LEDGER_NAME).write_bytes(b"flight")
        folder.close()
        assert folder.path == tmp_path / expected
    assert "holds an earlier flight" in folder.said
    assert str(tmp_path / "mosaic-3") in folder.said


def test_foreign_files_do_no_harm(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    folder = open_flight_folder(tmp_path)
    assert folder.path == tmp_path
    folder.close()


def test_foreign_file_of_our_name_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "trip"
    (out / "frames").mkdir(parents=True)
    folder = open_flight_folder(out)
    assert folder.path == tmp_path / "trip-2"
    assert list(out.iterdir()) == [out / "frames"]
    folder.close()


def test_the_working_folder_has_neighbours_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    (here / "tiles").mkdir(parents=True)
    monkeypatch.chdir(here)
    folder = open_flight_folder(Path())
    assert folder.path == tmp_path / "here-2"
    folder.close()


def test_two_programs_never_write_one_folder(tmp_path: Path) -> None:
    out = tmp_path / "mosaic"
    code = (
        "import pathlib, sys; from gcs_mosaic.store.folder import open_flight_folder as o; "
        "print(o(pathlib.Path(sys.argv[1])).path.name, flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == "mosaic"
        beside = open_flight_folder(out)
        assert beside.path.name == "mosaic-2"
        assert "another gcs-mosaic" in beside.said
        beside.close()
        other.kill()
    alone = open_flight_folder(out)
    assert alone.path.name == "mosaic"
    alone.close()


def test_file_in_the_way_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "mosaic").write_text("a file")
    with pytest.raises(UsageError, match="mosaic is not a folder: choose another --out"):
        open_flight_folder(tmp_path / "mosaic")


@pytest.mark.parametrize("length", [LONGEST_PATH - 1, LONGEST_PATH])
def test_the_longest_path_can_have_a_ledger(tmp_path: Path, length: int) -> None:
    out = tmp_path
    while (left := length - len(str(out))) > 200:
        out /= "c" * 100
    out /= "d" * (left - 1)
    assert len(str(out)) == length
    folder = open_flight_folder(out)
    with closing(connect(folder.path / LEDGER_NAME)) as opened:
        opened.execute("CREATE TABLE one (number)")
    folder.close()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("x" * 300, "too long"),
        ("/".join(["y" * 200] * 4), "choose a shorter --out"),
        ("m\udce4p", "is not UTF-8"),
        ("link", "is not a folder"),
    ],
)
def test_a_path_that_no_flight_can_have_is_a_clear_error(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(UsageError, match=said):
        open_flight_folder(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["link"]


def test_a_watched_folder_whose_name_cannot_be_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be watched"):
        refuse_watching_ourselves(tmp_path / ("x" * 300), tmp_path / "out")


def test_find_flight_wants_a_flight(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no flight"):
        find_flight(tmp_path)
    with pytest.raises(UsageError, match="does not exist"):
        find_flight(tmp_path / "never")
    (tmp_path / "mosaic.json").write_text("{}")
    assert find_flight(tmp_path) == tmp_path


@pytest.mark.parametrize("watched", [".", "mosaic", "mosaic/frames", "mosaic/tiles/0"])
def test_map_must_not_appear_in_the_watched_folder(tmp_path: Path, watched: str) -> None:
    with pytest.raises(UsageError, match="overlap"):
        refuse_watching_ourselves(tmp_path / watched, tmp_path / "mosaic")


@pytest.mark.parametrize("watched", ["frames", "mosaic/incoming", "mosaic-2"])
def test_other_places_may_be_watched(tmp_path: Path, watched: str) -> None:
    refuse_watching_ourselves(tmp_path / watched, tmp_path / "mosaic")


@pytest.mark.parametrize(("flights", "newest"), [("mosaic mosaic-2", 1), ("mosaic-2 mosaic", 1), ("mosaic-3", 0)])
def test_the_flight_that_was_written_last_is_gone_on_with(tmp_path: Path, flights: str, newest: int) -> None:
    """Whatever was removed: the next flight takes the first name that is free."""
    names = flights.split()
    for number, name in enumerate(names):
        begun_flight(tmp_path / name)
        os.utime(tmp_path / name / LEDGER_NAME, (1e9 + number, 1e9 + number))
    (tmp_path / names[0] / f"{LEDGER_NAME}-wal").touch()  # somebody has read it
    folder = resume_flight_folder(tmp_path / "mosaic")
    folder.close()
    assert folder.path.name == names[newest]


# A start that was killed before its flight began


def left_by_a_killed_start(out: Path, *names: str) -> None:
    out.mkdir()
    for name in names:
        if name == "ledger":
            connect(out / LEDGER_NAME).close()  # its tables, but no flight
        else:
            (out / name).write_text(
                "T INFO MainThread gcs_mosaic.app.status.flight_log: gcs-mosaic 1\n" if "log" in name else ""
            )


@pytest.mark.parametrize(
    "left",
    [
        "flight.log",
        ".gcs-mosaic.lock flight.log",
        ".gcs-mosaic.lock flight.log page.token flight.tlog",
        ".gcs-mosaic.lock flight.log flight.sqlite",
        ".gcs-mosaic.lock flight.log ledger",
        "ledger",
    ],
)
def test_what_a_killed_start_has_left_is_ours(tmp_path: Path, left: str) -> None:
    """Killed while the page's process loaded, up to half a minute on a busy machine; the next start went to mosaic-2."""
    out = tmp_path / "mosaic"
    left_by_a_killed_start(out, *left.split())
    folder = open_flight_folder(out)
    assert folder.path == out
    folder.close()


def test_a_flight_that_was_killed_before_anything_came_is_begun_again(tmp_path: Path) -> None:
    begun_flight(tmp_path / "mosaic")
    folder = open_flight_folder(tmp_path / "mosaic")
    assert folder.path == tmp_path / "mosaic"
    folder.close()


@pytest.mark.parametrize("name", ["frames", "mosaic.json", "checkpoint", "tiles", "status.json"])
def test_a_lock_makes_nothing_ours_that_no_start_writes(tmp_path: Path, name: str) -> None:
    out = tmp_path / "mosaic"
    left_by_a_killed_start(out, ".gcs-mosaic.lock", "flight.log", name)
    folder = open_flight_folder(out)
    assert folder.path == tmp_path / "mosaic-2"
    folder.close()


def test_a_log_of_another_program_stays_its_own(tmp_path: Path) -> None:
    (tmp_path / "trip").mkdir()
    (tmp_path / "trip" / "flight.log").write_text("12:00 take-off\n")
    folder = open_flight_folder(tmp_path / "trip")
    assert folder.path == tmp_path / "trip-2"
    folder.close()


def test_a_killed_start_is_no_flight_to_resume(tmp_path: Path) -> None:
    begun_flight(tmp_path / "mosaic")
    left_by_a_killed_start(tmp_path / "mosaic-2", ".gcs-mosaic.lock", "flight.log", "ledger")
    folder = resume_flight_folder(tmp_path / "mosaic")
    assert folder.path == tmp_path / "mosaic"
    folder.close()


def begun_flight(path: Path) -> None:
    path.mkdir()
    with Ledger(path / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name=path.name, started_utc=1.0))


@pytest.mark.parametrize("name", ["page.token", "flight.tlog", "notes.sqlite", "hints.sqlite"])
def test_without_lock_log_or_ledger_of_ours_no_start_was_killed_there(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("somebody's own")
    assert occupied(tmp_path) == f"{tmp_path} has its own {name}, which is left as it is"
    (tmp_path / "flight.log").write_text("2024-05-01 INFO gcs_mosaic: the start\n")
    assert occupied(tmp_path) == ""


def test_where_no_flight_is_none_is_resumed(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no flight to go on with"):
        resume_flight_folder(tmp_path / "out")
