from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from gcs_mosaic.store.disk import DiskFull, is_disk_full, make_folder, overwrite, write_beside


def test_reader_never_sees_half_a_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    contents = [bytes([n]) * 200_000 for n in range(40)]
    write_beside(path, contents[0])

    def write_all() -> None:
        for data in contents:
            write_beside(path, data)

    writer = threading.Thread(target=write_all)
    writer.start()
    seen = [path.read_bytes() for _ in range(200)]
    writer.join(10)
    assert all(data in contents for data in seen)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_full_disk_leaves_the_old_file_and_no_litter(tiny_disk: Path) -> None:
    path = tiny_disk / "file"
    write_beside(path, b"old")
    with pytest.raises(DiskFull, match="free some space"):
        write_beside(path, b"x" * 2_000_000)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tiny_disk.iterdir()] == ["file"]


def test_other_errors_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_beside(tmp_path / "no" / "folder", b"")
    assert not is_disk_full(FileNotFoundError(2, "no such file"))


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells the names of open files there")
def test_what_is_to_last_is_synced_before_and_after_it_takes_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a power cut on FAT a file that was renamed and not synced again was empty; on others its name was the old one."""
    sync, replace, done = os.fsync, os.replace, list[str]()

    def synced(descriptor: int) -> None:
        done.append(f"sync {Path(f'/proc/self/fd/{descriptor}').readlink().name}")
        sync(descriptor)

    def renamed(old: str, new: str, **where: int) -> None:
        replace(old, new, **where)
        done.append("rename")

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    write_beside(tmp_path / "file", b"new", durable=True)
    assert done == ["sync .file.part", "rename", "sync file", f"sync {tmp_path.name}"]
    done.clear()
    write_beside(tmp_path / "file", b"newer")
    assert done == ["rename"]


def test_folders_that_are_to_last_are_synced_into_those_above(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = list[Path]()
    monkeypatch.setattr("gcs_mosaic.store.disk.sync_folder", synced.append)
    make_folder(tmp_path / "a" / "b", tmp_path, durable=True)
    assert synced == [tmp_path, tmp_path / "a"]
    make_folder(tmp_path / "a" / "b", tmp_path, durable=True)
    make_folder(tmp_path / "c", tmp_path)
    assert len(synced) == 2


@pytest.mark.skipif(os.name != "posix", reason="links are for administrators there")
def test_a_link_beside_or_above_is_not_followed(tmp_path: Path) -> None:
    """A stranger's folder had links under the names of files that were being written, and in the place of `tiles`."""
    outside, root = tmp_path / "outside", tmp_path / "root"
    outside.mkdir()
    root.mkdir()
    (outside / "file").write_text("precious")
    (root / ".a.part").symlink_to(outside / "file")
    (root / "b").symlink_to(outside / "file")
    (root / "tiles").symlink_to(outside)
    for name in "ab":
        write_beside(root / name, b"ours")
        assert (root / name).read_bytes() == b"ours"
    for write in (write_beside, lambda path, data, root: make_folder(path, root)):
        with pytest.raises(NotADirectoryError):
            write(root / "tiles" / "file", b"ours", root=root)
    with pytest.raises(OSError, match="symbolic links"):
        overwrite_link(root, outside)
    assert (outside / "file").read_text() == "precious"
    assert [path.name for path in outside.iterdir()] == ["file"]


def overwrite_link(root: Path, outside: Path) -> None:
    (root / "c").symlink_to(outside / "file")
    overwrite(root / "c", b"ours")
