"""Where a map goes: only what is ours is touched, what is made again is whole, and nothing is left behind."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_mosaic.archive.files import UNFINISHED, FolderFiles
from gcs_mosaic.archive.packing import _write_tiles, beside, move_into_place
from gcs_mosaic.archive.painting import ArchiveMap
from gcs_mosaic.archive.reprocess import Request, reprocess
from gcs_mosaic.archive.super_tiles import SuperTile, SuperTileLayout
from gcs_mosaic.archive.target import MARKER, checked_target
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import LEDGER_NAME
from tests.archive.archives import Heard
from tests.frames.image_files import encoded
from tests.ports import free_port

pytestmark = pytest.mark.filterwarnings("default")


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def put(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@pytest.mark.long
@pytest.mark.usefixtures("soon_given_up")
def test_where_no_scheduler_answers_nothing_is_left_behind(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(encoded(".jpg"))
    request = Request((str(tmp_path / "a.jpg"),), str(tmp_path / "of/maps/one"), f"tcp://127.0.0.1:{free_port()}")
    with pytest.raises(UsageError, match="no scheduler answers there"):
        reprocess(request, Config(), Heard())
    assert [path.name for path in tmp_path.iterdir()] == ["a.jpg"]


@pytest.mark.parametrize("name", ["archive/1999/a.jpg", "frames/a.jpg", "flight.sqlite"])
def test_a_folder_that_holds_what_is_not_ours_is_left_alone(tmp_path: Path, name: str) -> None:
    put(tmp_path, name)
    with pytest.raises(UsageError, match="which is left as it is: choose another one"):
        checked_target(str(tmp_path)).__enter__()
    assert files_in(tmp_path) == {name}


@pytest.mark.skipif(os.name != "posix", reason="links are for administrators there")
@pytest.mark.parametrize("link", ["archive", "archive/unfinished", "archive/packing-x", "tiles", "flight.sqlite"])
def test_a_link_in_the_target_is_not_followed(tmp_path: Path, link: str) -> None:
    """`reprocess --out` emptied a folder of somebody else, to which `archive` of a target that was handed over led."""
    outside = put(tmp_path / "else", "gcs-mosaic-reprocess", "packing-x/precious", "unfinished/precious")
    target = put(tmp_path / "map", MARKER) if link != "archive" else tmp_path / "map"
    (target / link).parent.mkdir(parents=True, exist_ok=True)
    (target / link).symlink_to(outside)
    before = files_in(outside)
    with pytest.raises(UsageError, match="is a link or a device, which no flight's folder has"):
        checked_target(str(target)).__enter__()
    assert files_in(outside) == before
    assert (target / link).is_symlink()


def test_a_flight_beside_somebody_s_folder_of_that_name_is_left_alone(tmp_path: Path) -> None:
    put(tmp_path, "mosaic.json", "archive/a.jpg")
    with pytest.raises(UsageError, match="holds an earlier flight"):
        checked_target(str(tmp_path)).__enter__()
    assert files_in(tmp_path) == {"mosaic.json", "archive/a.jpg"}


def test_what_an_earlier_run_has_made_is_gone_on_with_and_what_it_left_unfinished_is_removed(tmp_path: Path) -> None:
    with checked_target(str(tmp_path)):
        put(tmp_path, "archive/features/a", "mosaic.json")
    put(tmp_path, f"archive/{UNFINISHED}/1f", "archive/packing-x/made/tiles/0/1.jpg")
    with checked_target(str(tmp_path)):
        assert files_in(tmp_path) == {MARKER, "archive/features/a", "mosaic.json", ".gcs-mosaic.lock"}
    assert MARKER in files_in(tmp_path)


def test_a_file_that_cannot_be_written_leaves_no_part_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(CannotWrite):
        FolderFiles(tmp_path).write("taken", b"data")
    assert files_in(tmp_path) == set()


def test_two_workers_that_write_the_same_do_not_meet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Process numbers do not tell workers of two machines apart."""
    begun: list[Path] = []
    move = inside.move

    def noted(path: Path, target: Path, root: Path) -> None:
        begun.append(path)
        move(path, target, root)

    monkeypatch.setattr(inside, "move", noted)
    for _ in range(2):
        FolderFiles(tmp_path).write("a/b", b"data")
    assert len(set(begun)) == 2
    assert [one.name for one in FolderFiles(tmp_path).listed("")] == ["a/b"]


def test_a_worker_that_does_not_see_the_folder_says_so(tmp_path: Path) -> None:
    with pytest.raises(CannotWrite, match=r"gone is not there: all workers need the same folder$"):
        FolderFiles(tmp_path / "gone").write("a/b", b"data")
    assert not list(tmp_path.iterdir())


def test_a_map_that_is_made_again_leaves_nothing_of_the_earlier_one(tmp_path: Path) -> None:
    added = ("notes.sqlite", "page.token", "flight.log", "archive/features/a")
    older = ("tiles/0/16/1/1.jpg", "masks/0/16/1/1.png", "frames/old.jpg", "placements.json", "checkpoint")
    put(tmp_path, *added, *older, LEDGER_NAME, f"{LEDGER_NAME}-wal", f"{LEDGER_NAME}-shm", "mosaic.json")
    with beside(tmp_path / "archive") as made:
        put(made, LEDGER_NAME, "mosaic.json", "frames/new.jpg")
        move_into_place(made, tmp_path)
    assert files_in(tmp_path) == {*added, LEDGER_NAME, "mosaic.json", "frames/new.jpg"}


@pytest.mark.parametrize("place", [("../../../../notes", 0), (3, "x"), (16, 0), (None, 0)])
def test_tiles_that_are_not_a_super_tile_s_own_are_never_written(tmp_path: Path, place: tuple[Any, Any]) -> None:
    engine: Any = SimpleNamespace(part=lambda key, name: [(*place, b"jpeg", None)])
    with pytest.raises(FlightFailed, match="the artefact the/key names tiles that are not its own"):
        _write_tiles(engine, ArchiveMap(SuperTileLayout(), {SuperTile(0, 16, 0, 0): "the/key"}, 16), tmp_path / "made")
    assert not list(tmp_path.iterdir())
