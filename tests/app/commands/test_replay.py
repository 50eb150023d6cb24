"""A flight is recorded, and flown again from the recording: as it was, and the same every time."""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.store.folder import LEDGER_NAME, PROGRESS_NAME
from gcs_mosaic.store.status import read_status
from tests.running import Running, events_of, flying, frames_of, run, six_pictures

pytestmark = pytest.mark.long

LONG_AGO = 1.6e9  # seconds since 1970
TABLES = "events", "frames", "estimates", "painted", "islands", "cameras"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Running:
    """A flight of six pictures with a lost one, a repeated message, a damaged file and a copy; recorded."""
    pictures = six_pictures(world_cache)
    with flying(tmp_path_factory.mktemp("flown"), "--record") as flight:
        for k, picture in enumerate(pictures):
            flight.vehicle.tick(None)
            flight.take(f"DCIM/IMG_{k:04d}.JPG", picture)
            if k == 3:
                flight.trigger("DCIM/IMG_9999.JPG")  # never comes
                flight.taken -= 1
                flight.trigger("DCIM/IMG_9999.JPG")
        flight.take("DCIM/cut.jpg", pictures[0][:20_000])
        flight.take("DCIM/copy.jpg", pictures[2])
        flight.wait_for_frames(placed=6, damaged=1, duplicate=1)
        assert flight.end() == 0
        return flight


def flown_again(flown: Running, out: Path, *words: str, frames: Path | None = None) -> Path:
    asked = ["replay", flown.out / "flight.tlog", "--frames", frames or flown.watch, "--out", out, *words]
    assert main([str(word) for word in asked]) == 0
    return out


def accounts(out: Path) -> list[tuple[object, ...]]:
    """Every row of the ledger but what was said."""
    with closing(sqlite3.connect(out / LEDGER_NAME)) as ledger:
        return [row for table in TABLES for row in ledger.execute(f"SELECT * FROM {table} ORDER BY rowid")]


def files(out: Path) -> dict[str, bytes]:
    """Everything that was written but the ledger and its like, and how far the command was, which has its times."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.suffix in (".json", ".jpg", ".png") and path.name != PROGRESS_NAME
    }


@pytest.fixture(scope="module")
def again(flown: Running, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flown again by a process of its own."""
    place = tmp_path_factory.mktemp("again")
    done = run("replay", flown.out / "flight.tlog", "--frames", flown.watch, "--out", "mosaic", cwd=place)
    assert done.returncode == 0, done.stderr
    (place / "said").write_text(done.stdout)
    return place / "mosaic"


def outcome(out: Path) -> tuple[object, ...]:
    states = {name: (frame.state, frame.reason, frame.had_event) for name, frame in frames_of(out).items()}
    return states, events_of(out)


def test_the_flight_comes_out_as_it_was(flown: Running, again: Path) -> None:
    assert outcome(again) == outcome(flown.out)
    assert sorted(events_of(again)) == ["duplicate", *["matched"] * 7, *["missing"] * 2]
    assert sorted(frame.state for frame in frames_of(again).values()) == ["damaged", "duplicate", *["placed"] * 6]


@pytest.mark.thorough
@pytest.mark.parametrize("words", [(), ("--speed", "8")], ids=["as fast as it goes", "eight times as fast"])
def test_the_result_is_the_same_every_time(flown: Running, again: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    third = flown_again(flown, tmp_path / "mosaic", *words)
    assert files(third) == files(again)
    assert {"mosaic.json", "placements.json"} < set(files(third))
    assert accounts(third) == accounts(again)


@pytest.mark.thorough
def test_copies_that_lost_their_times_come_out_the_same(flown: Running, tmp_path: Path) -> None:
    for path in shutil.copytree(flown.watch, tmp_path / "copies").rglob("*.*"):
        os.utime(path, (LONG_AGO, LONG_AGO))
    assert outcome(flown_again(flown, tmp_path / "mosaic", frames=tmp_path / "copies")) == outcome(flown.out)


def test_what_it_is_doing_is_said(again: Path) -> None:
    said = " ".join((again.parent / "said").read_text().split())
    assert "8 files, which came as told by the files' times" in said
    assert "6 of 8 frames placed" in said
    assert "held-out matches: " in said
    assert "events: 7 matched, 2 missing, 1 duplicate" in said
    assert read_status(again).startswith("replay: ended, begun ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("none.tlog", "--frames", "FRAMES"), "'none.tlog' cannot be read (No such file or directory): give"),
        (("text.tlog", "--frames", "FRAMES"), "'text.tlog' holds no MAVLink packet: give a recording"),
        ((".", "--frames", "FRAMES"), "'.' cannot be read (Is a directory): give"),
        (("FLIGHT", "--frames", "none"), "'none' cannot be read (No such file or directory): give"),
        (("FLIGHT", "--frames", "empty"), "'empty' holds no images: give"),
        (("FLIGHT", "--frames", "FRAMES", "--speed", "-1"), "--speed -1 is not understood: give"),
        (("FLIGHT", "--frames", "FRAMES", "--speed", "nan"), "--speed nan is not understood: give"),
        (("FLIGHT",), "the following arguments are required: --frames"),
    ],
)
def test_what_cannot_be_flown_again_is_told_in_one_sentence(
    flown: Running,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    said: str,
) -> None:
    (tmp_path / "text.tlog").write_bytes(b"no recording at all\n" * 99)
    (tmp_path / "empty").mkdir()
    known = {"FRAMES": flown.watch, "FLIGHT": flown.out / "flight.tlog"}
    monkeypatch.chdir(tmp_path)
    assert main(["replay", *(str(known.get(word, word)) for word in words), "--out", "mosaic"]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "mosaic").exists()
