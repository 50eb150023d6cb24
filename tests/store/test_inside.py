from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import chdir, closing
from pathlib import Path
from shutil import rmtree

import pytest

from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import write_beside

posix = pytest.mark.skipif(os.name != "posix", reason="makes links, pipes and paths of any length")
PACKAGE = Path(inside.__file__).parents[1]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A flight's folder, and beside it what it must not reach."""
    outside, root = tmp_path / "outside", tmp_path / "root"
    (outside / "deep").mkdir(parents=True)
    (outside / "file").write_text("precious")
    (root / "folder").mkdir(parents=True)
    (root / "folder" / "file").write_text("ours")
    (root / "link").symlink_to(outside / "file")
    (root / "dangling").symlink_to(outside / "new")
    (root / "way").symlink_to(outside)
    (root / "loop").symlink_to(root)
    os.mkfifo(root / "pipe")
    return root


ELSEWHERE = ("link", "dangling", "way/file", "loop/folder/file", "pipe", "folder", "folder/../../outside/file", "")


@posix
@pytest.mark.parametrize("name", ELSEWHERE)
def test_nothing_but_a_file_of_the_folder_is_opened(root: Path, name: str) -> None:
    with pytest.raises(OSError, match=r"."):
        inside.read(root / name, root)
    with pytest.raises(OSError, match=r"."):
        os.close(inside.descriptor(root / name, root, os.O_WRONLY | os.O_CREAT | os.O_TRUNC))
    assert not inside.is_file(root / name, root)
    assert sorted(path.name for path in (root.parent / "outside").iterdir()) == ["deep", "file"]
    assert (root.parent / "outside" / "file").read_text() == "precious"


@posix
def test_a_path_elsewhere_is_no_path_of_the_folder(root: Path) -> None:
    for path in (Path("/etc/passwd"), root.parent / "outside/file", root / "a\0b"):
        with pytest.raises(OSError, match=r"."):
            inside.read(path, root)


@posix
def test_the_folder_itself_may_be_reached_by_a_link(root: Path) -> None:
    (root.parent / "named").symlink_to(root)
    named = root.parent / "named"
    assert inside.read(named / "folder/file", named) == b"ours"


@posix
@pytest.mark.parametrize(
    "change", [inside.remove, inside.remove_folder, lambda path, root: inside.move(path, root / "x", root)]
)
@pytest.mark.parametrize("name", ["way/file", "way/deep", "way", "link", "loop/folder/file"])
def test_nothing_elsewhere_is_removed_or_renamed(root: Path, name: str, change: Callable[[Path, Path], None]) -> None:
    """A link itself may go."""
    try:
        change(root / name, root)
    except OSError:
        assert "/" in name
    assert sorted(path.name for path in (root.parent / "outside").iterdir()) == ["deep", "file"]
    assert (root / "folder" / "file").exists()


@posix
def test_what_is_listed_lies_in_the_folder(root: Path) -> None:
    assert list(inside.files(root, root)) == [root / "folder/file"]
    assert list(inside.files(root / "way", root)) == []
    assert {path.name for path, entry in inside.entries(root, root) if not inside.is_plain(entry)} == {
        *("link", "dangling", "way", "loop", "pipe"),
    }


@posix
def test_folders_are_made_below_folders_alone(root: Path) -> None:
    assert inside.make_folder(root / "folder/a/b", root) == [root / "folder/a", root / "folder/a/b"]
    assert inside.make_folder(root / "folder/a/b", root) == []
    for name in ("way/new", "link/new", "way"):
        with pytest.raises(OSError, match=r"."):
            inside.make_folder(root / name, root)
    assert sorted(path.name for path in (root.parent / "outside").iterdir()) == ["deep", "file"]


@posix
def test_what_is_read_is_bounded(root: Path) -> None:
    with pytest.raises(OSError, match="more than"):
        inside.read(root / "folder/file", root, 3)
    with (root / "sparse").open("wb") as file:
        file.truncate(1 << 31)
    with pytest.raises(OSError, match="holes"):
        inside.read(root / "sparse", root)


LIMITED = """
import resource, sys
from pathlib import Path
from gcs_mosaic.store import inside
resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
print(len(inside.read(Path(sys.argv[1]) / "folder" / "file", Path(sys.argv[1]))))
"""


@pytest.mark.long
@posix
def test_no_more_memory_is_asked_for_than_the_file_takes(root: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED, str(root)], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == (f"{len((root / 'folder/file').read_bytes())}\n", "")


@posix
def test_what_has_grown_since_its_size_was_asked_is_read_whole(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = (root / "folder/file").read_bytes()
    asked = os.fstat

    def before_it_grew(descriptor: int) -> os.stat_result:
        found = list(asked(descriptor))
        return os.stat_result([*found[:6], len(whole) - 2, *found[7:]])

    monkeypatch.setattr(os, "fstat", before_it_grew)
    monkeypatch.setattr(inside, "is_mostly_holes", lambda found: False)
    assert inside.read(root / "folder/file", root) == whole
    with pytest.raises(OSError, match="more than"):
        inside.read(root / "folder/file", root, len(whole) - 1)


@pytest.mark.long
@posix
def test_folders_deeper_than_any_path_are_left_out(root: Path) -> None:
    here = os.open(root / "folder", os.O_RDONLY)
    for _ in range(3000):
        os.mkdir("d", dir_fd=here)
        below = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = below
    os.close(here)
    assert list(inside.files(root, root)) == [root / "folder/file"]
    remove_deep(root / "folder")


def remove_deep(folder: Path) -> None:
    """What pytest cannot remove: a path that is too long."""
    with chdir(folder):
        for _ in range(3000):
            os.chdir("d")
        for _ in range(3000):
            os.chdir("..")
            Path("d").rmdir()


# Files that open, rename or remove by themselves, and why they may: none of them touches what lies in a flight's folder that is
# there already. Whoever has to add one asks first whether `inside` would do.
RAW = re.compile(
    r"(?<!inside)(?:(?<!\))\.replace|\.(?:open|read_bytes|read_text|write_bytes|write_text|unlink|rename|rglob|glob|touch|hardlink_to))\((?![^)\n]*\")"
    r"|\bopen\(|\bos\.(?:open|replace|rename|unlink|remove|walk|truncate)\(|rmtree\("
)
ROOMS = ("store", "check", "views", "notes", "export", "archive", "web/api")
ALLOWED = {
    "store/inside.py": "the door itself",
    "store/disk.py": "syncs folders",
    "store/checkpoint.py": "the program's own source; values in a folder that was looked at",
    "store/ledger_file.py": "a ledger that is made anew beside",
    "check/snapshot.py": "a copy in a scratch folder",
    "export/whole_file.py": "where the user wants an export",
    "export/cog_layout.py": "where the user wants an export",
    "export/earth_raster.py": "where the user wants an export",
    "export/earth_features.py": "where the user wants an export",
    "export/missions.py": "where the user wants an export",
    "export/debriefing.py": "where the user wants an export",
    "export/tile_archives.py": "where the user wants an export",
    "archive/target.py": "makes its marker in a folder that was looked at",
    "archive/sources.py": "files that the user names",
    "archive/packing.py": "what it has just made in a scratch folder",
}


def test_whoever_touches_a_flights_folder_goes_through_the_door() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): lines
        for room in ROOMS
        for path in (PACKAGE / room).rglob("*.py")
        if (lines := [line.strip() for line in path.read_text("utf-8").splitlines() if raw(line)])
    }
    assert {name: lines for name, lines in found.items() if name not in ALLOWED} == {}
    assert set(ALLOWED) - set(found) == set(), "allowed without need"


def raw(line: str) -> bool:
    code = line.split("  #")[0].strip()
    return bool(RAW.search(code)) and not code.startswith(("def ", "from ", "import ", '"""', "#"))


def test_a_root_that_stays_open_writes_where_folders_are_made_anew(tmp_path: Path) -> None:
    with closing(inside.OpenRoot(tmp_path)) as root:
        inside.make_folder(tmp_path / "a/b", root)
        write_beside(tmp_path / "a/b/1", b"one", root=root)
        rmtree(tmp_path / "a")
        with pytest.raises(FileNotFoundError):
            write_beside(tmp_path / "a/b/2", b"two", root=root)
        inside.make_folder(tmp_path / "a/b", root)
        write_beside(tmp_path / "a/b/2", b"two", root=root)
    assert (tmp_path / "a/b/2").read_bytes() == b"two"


@posix
def test_a_root_that_stays_open_follows_no_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "flight").mkdir()
    (tmp_path / "flight/way").symlink_to(tmp_path / "elsewhere")
    with closing(inside.OpenRoot(tmp_path / "flight")) as root, pytest.raises(NotADirectoryError):
        write_beside(tmp_path / "flight/way/file", b"ours", root=root)
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are counted in /proc")
def test_a_root_that_stays_open_keeps_a_limited_number_of_folders_and_closes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inside, "MOST_OPEN", 3)
    before = len(list(Path("/proc/self/fd").iterdir()))
    with closing(inside.OpenRoot(tmp_path)) as root:
        for number in range(8):
            (tmp_path / str(number)).mkdir()
            write_beside(tmp_path / str(number) / "file", b"ours", root=root)
            inside.remove(tmp_path / str(number) / "none", root)
        assert len(list(Path("/proc/self/fd").iterdir())) == before + 3
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert all((tmp_path / str(number) / "file").read_bytes() == b"ours" for number in range(8))
