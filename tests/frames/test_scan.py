"""One look at a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.frames.scan import _named, scan


@pytest.mark.parametrize("given", ["", ".", "DCIM/..", "DCIM/../DCIM/.."])
def test_names_are_those_in_the_folder_however_it_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    (tmp_path / "DCIM" / "100 é").mkdir(parents=True)
    wanted = {"a.JPG", "DCIM/b.jpg", "DCIM/100 é/c.tif", "two\\x0alines.png"}
    for name in wanted:
        (tmp_path / name.replace("\\x0a", "\n")).write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    for _ in range(2):  # what was parsed is kept
        found = scan(Path(given) if given else tmp_path).images
        assert {look.name for look in found} == wanted
        assert all(look.path.is_file() for look in found)


def test_files_still_being_fetched_are_passed_over(tmp_path: Path) -> None:
    for name in ("a.jpg.part", "b.JPG.PART", "c.crdownload", "d.tmp", ".e.jpg", "f.jpg"):
        (tmp_path / name).write_bytes(b"x")
    found = scan(tmp_path)
    assert [look.name for look in found.images] == ["f.jpg"]
    assert not found.strangers


@pytest.mark.long
def test_a_season_of_pictures_is_known_from_the_scan_before(tmp_path: Path) -> None:
    """Of 20,000 old ones none was, and new frames came half a minute late."""
    for number in range(20_000):
        (tmp_path / f"{number}.jpg").touch()
    scan(tmp_path)
    before = _named.cache_info().misses
    assert len(scan(tmp_path).images) == 20_000
    assert _named.cache_info().misses == before
