"""gcs-mosaic check: a flight that is whole is found so, each damage is found, and repaired so that nothing is found again."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.check.check import check, repair
from gcs_mosaic.check.findings import Findings
from gcs_mosaic.check.table import verdict
from gcs_mosaic.cli import main as cli
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import SourceReport
from gcs_mosaic.store.checkpoint import MAGIC
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.schema import VERSION
from gcs_mosaic.store.status import AircraftStatus, Status, status_document
from tests.ended_flights import ended_flight, photographed
from tests.sure import sure

CONFIG = Config()
Damage = Callable[[Path], object]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """What the camera has written."""
    return photographed(tmp_path_factory.mktemp("camera"), world_cache)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """A flight of six frames that has ended."""
    return ended_flight(tmp_path_factory.mktemp("flown") / "mosaic", world_cache)


@pytest.fixture
def flight(tmp_path: Path, flown: Path) -> Path:
    """A copy to be damaged."""
    return shutil.copytree(flown, tmp_path / "mosaic")


def checked(flight: Path, *, every_tile: bool = True) -> Findings:
    return check(flight, lambda what, done, of: None, every_tile=every_tile)


def repaired(flight: Path, *sources: Path) -> Findings:
    return repair(flight, lambda what, done, of: None, sources)


def files_in(flight: Path) -> dict[Path, bytes]:
    return {path.relative_to(flight): path.read_bytes() for path in flight.rglob("*") if path.is_file()}


def said_of(found: Findings) -> str:
    return " ".join(f"{fault.subject}: {fault.text}." for part in found.parts for fault in part.faults)


def a_tile(flight: Path, number: int = 8) -> Path:
    return sorted((flight / "tiles").rglob("*.jpg"))[number]


def sql(statement: str) -> Damage:
    def damage(flight: Path) -> None:
        with closing(sqlite3.connect(flight / LEDGER_NAME)) as connection, connection:
            connection.execute(statement)

    return damage


def flip(name: str) -> Damage:
    """Change a byte in the middle of a file."""

    def damage(flight: Path) -> None:
        data = bytearray((flight / name).read_bytes())
        data[len(data) // 2] ^= 0xFF
        (flight / name).write_bytes(data)

    return damage


def many(flight: Path) -> None:
    """Damage of every kind that does not hide another."""
    a_tile(flight, 5).write_bytes(b"")
    a_tile(flight, 8).unlink()
    sorted((flight / "masks").rglob("*.png"))[3].unlink()
    shutil.copytree(flight / "masks/0", flight / "masks/8")
    shutil.copytree(flight / "tiles/0", flight / "tiles/7")
    (flight / "tiles/0/.1.jpg.part").write_bytes(b"1")
    (flight / "mosaic.json").write_bytes(b"{")
    (flight / "placements.json").unlink()
    (flight / "status.json").write_bytes(b"")
    flip("checkpoint")(flight)


# By name: the damage, and what is said of it.
DAMAGES: dict[str, tuple[Damage, tuple[str, ...]]] = {
    "tile of another place": (lambda flight: shutil.copy(a_tile(flight, 4), a_tile(flight)), ("does not show what",)),
    "many at once": (
        many,
        (
            *(
                "cannot be decoded",
                "does not show what",
                "without its tile",
                "no frame of the ledger",
                "never finished",
            ),
            *("mosaic.json: a document that cannot be read", "placements.json: a document that is missing"),
            *("status.json: a document that cannot be read", "checkpoint is damaged"),
        ),
    ),
    "rows, documents": (sql("UPDATE frames SET state = 'waiting' WHERE id = 3"), ("painted, but not placed",)),
    "values of the checkpoint": (lambda flight: (flight / "checkpoint.values").unlink(), ("refers, is missing",)),
    "ledger cut": (lambda flight: os.truncate(flight / LEDGER_NAME, 3 * 4096), ("flight.sqlite",)),
}
CASES = [name if name.startswith("tile") else pytest.param(name, marks=pytest.mark.long) for name in DAMAGES]


@pytest.mark.long
def test_a_whole_flight_is_found_whole_and_left_alone(flight: Path) -> None:
    before = files_in(flight)
    found = checked(flight)
    assert said_of(found) == ""
    assert {part.name: part.checked for part in found.parts if part.name != "tiles"} == {
        **{"ledger": 6, "originals": 6, "documents": 3},
        **{"checkpoint": 1, "strays": 0, "notes": 0},
    }
    assert files_in(flight) == before


@pytest.mark.long
def test_a_flight_of_another_version_of_the_program_is_whole_and_can_still_be_gone_on_with(flight: Path) -> None:
    head = len(MAGIC) + 4  # and then the digest of the program
    data = bytearray((flight / "checkpoint").read_bytes())
    data[head] ^= 0xFF
    (flight / "checkpoint").write_bytes(data)
    found = checked(flight)
    assert found.is_whole, said_of(found)
    (part,) = [part for part in found.parts if part.name == "checkpoint"]
    assert "written by another version of the program: to go on with the flight is to stitch" in part.notes[0]
    repaired(flight)
    assert (flight / "checkpoint").read_bytes() == data


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_damage_is_found_and_repaired(flight: Path, name: str) -> None:
    damage, words = DAMAGES[name]
    damage(flight)
    before = files_in(flight)
    said = said_of(checked(flight))
    assert [word for word in words if word not in said] == []
    assert files_in(flight) == before
    found = repaired(flight)
    assert found.repaired
    # What the documents tell beyond a ledger that was lost is not overwritten; the checkpoint may bring it back.
    assert found.is_whole == (name != "ledger cut"), said_of(found)


@pytest.mark.long
def test_a_ledger_that_is_lost_is_said_each_time_and_nothing_is_made_worse(flight: Path) -> None:
    (flight / LEDGER_NAME).write_bytes(b"")
    first = repaired(flight)
    assert not first.is_whole
    assert first.resumable or "checkpoint" in " ".join(first.repaired)
    before = files_in(flight)
    again = repaired(flight)
    assert said_of(again) == said_of(first)
    remedy = verdict(first, mended=True)
    assert "cannot be repaired" in remedy
    assert verdict(checked(flight), mended=False) == remedy  # and does not promise what was just tried
    changed = {path for path, data in files_in(flight).items() if before.get(path) != data}
    assert changed <= {Path(LEDGER_NAME)}


@pytest.mark.long
def test_a_damaged_original_is_taken_from_the_camera_s_files(flight: Path, pictures: Path) -> None:
    flip("frames/2.jpg")(flight)
    (flight / "frames/3.jpg").unlink()
    assert {fault.subject for fault in checked(flight, every_tile=False).parts[1].faults} == {"2.jpg", "3.jpg"}
    assert repaired(flight, pictures).is_whole
    assert (flight / "frames/2.jpg").read_bytes() == (pictures / "2.jpg").read_bytes()
    assert (flight / "frames/3.jpg").read_bytes() == (pictures / "3.jpg").read_bytes()


@pytest.mark.long
def test_half_a_copy_says_what_it_lacks_and_is_made_whole_once_the_camera_s_files_are_there(
    flight: Path, pictures: Path
) -> None:
    """A copy was broken off, and repaired before anybody thought of the camera's card."""
    before = {path: data for path, data in files_in(flight).items() if path.parts[0] in {"tiles", "masks", "frames"}}
    for folder in ("tiles", "frames"):
        files = sorted(path for path in (flight / folder).rglob("*.*") if path.is_file())
        for path in files[len(files) // 3 :]:
            path.unlink()
    found = repaired(flight)
    assert found.lost.tiles > 5
    told = f"whole again, but for what is lost: 4 originals; {found.lost.tiles} tiles"
    assert verdict(found, mended=True) == f"{flight} is {told}"
    assert verdict(repaired(flight, pictures), mended=True) == f"{flight} is whole"
    assert {path: data for path, data in files_in(flight).items() if path in before} == before


@pytest.mark.long
def test_each_aircraft_s_own_folder_is_looked_through_too(flight: Path, pictures: Path) -> None:
    """The status names one of the folders for all: the one that brings nothing, if there is any."""
    lost = SourceReport(kind="folder", name=str(flight.parent / "card"), state="missing", vehicle=1)
    of_each = (
        AircraftStatus(system=1, source=lost),
        AircraftStatus(system=3),
        AircraftStatus(system=2, source=watching(pictures)),
    )
    status = Status(flight="mosaic", state="stopped", updated_utc=2.0, started_utc=1.0, watch=lost, aircraft=of_each)
    write_json(flight / "status.json", status_document(status))
    (flight / "frames/3.jpg").unlink()
    repaired(flight)
    assert (flight / "frames/3.jpg").read_bytes() == (pictures / "3.jpg").read_bytes()


def watching(folder: Path) -> SourceReport:
    return SourceReport(kind="folder", name=str(folder), state="watching", vehicle=2)


@pytest.mark.long
def test_what_a_lost_original_shows_stays_on_the_map(flight: Path) -> None:
    flip("frames/2.jpg")(flight)
    before = {path: data for path, data in files_in(flight).items() if path.parts[0] in ("tiles", "masks")}
    found = repaired(flight)
    assert found.is_whole, said_of(found)
    assert "2.jpg: its original is lost" in " ".join(found.repaired)
    assert found.document()["lost"] == {"unread": "", "originals": ["2.jpg"], "tiles": 0}
    assert verdict(found, mended=True) == f"{flight} is whole again, but for what is lost: 1 original"
    assert (flight / "frames/2.jpg.damaged").exists()
    assert {path: data for path, data in files_in(flight).items() if path in before} == before


def test_an_original_outside_the_folder_is_not_looked_at(flight: Path) -> None:
    sql("UPDATE frames SET original = 'frames/../../secret' WHERE id = 1")(flight)
    assert "said to lie outside" in said_of(checked(flight, every_tile=False))


def test_a_flight_that_is_being_written_is_checked_and_not_repaired(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lock = sure(try_lock(flight))
    a_tile(flight).unlink()  # tiles may be under way
    before = files_in(flight)
    found = checked(flight)
    assert found.is_whole
    assert "the flight is being written" in " ".join(found.parts[0].notes)
    assert cli.main(["check", str(flight), "--repair"]) == 2
    said = capsys.readouterr().err
    assert "is being written by another gcs-mosaic: end that one first" in said
    assert said.count("\n") == 1
    changed = files_in(flight).items() - before.items()
    assert all(
        path.name.startswith(f"{LEDGER_NAME}-") for path, _ in changed
    )  # which whoever writes it has open anyway
    lock.release()


def test_a_ledger_of_a_newer_version_is_refused_in_one_sentence(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sql(f"PRAGMA user_version = {VERSION + 1}")(flight)
    for words in ([], ["--repair"]):
        assert cli.main(["check", str(flight), *words]) == 2
        said = capsys.readouterr().err
        assert "was written by a newer gcs-mosaic" in said
        assert said.count("\n") == 1


def test_the_exit_code_and_the_document_tell_whether_it_is_whole(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["check", str(flight)]) == 0
    assert f"{flight} is whole" in capsys.readouterr().out.replace("\n", "")
    (flight / "mosaic.json").unlink()
    assert cli.main(["check", str(flight), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["whole"] is False
    assert document["lost"] == {"unread": "", "originals": [], "tiles": 0}
    faults = [(part["name"], fault) for part in document["parts"] for fault in part["faults"]]
    assert faults == [("documents", {"subject": "mosaic.json", "text": "a document that is missing"})]


def test_frames_are_named_for_a_repair_only(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(flight), "--frames", "."]) == 2
    assert "--repair" in capsys.readouterr().err


def test_no_flight_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no flight"):
        checked(tmp_path)
