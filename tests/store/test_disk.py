from __future__ import annotations

import threading
from pathlib import Path

import pytest

from gcs_mosaic.store.disk import DiskFull, is_disk_full, write_beside


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
