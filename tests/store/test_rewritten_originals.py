"""Originals that newer bytes replace."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.store.rewritten import RewrittenFiles


def test_old_originals_are_removed_from_the_folder_of_originals_alone(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    inner, outer = folder / "a.jpg", tmp_path / "a.jpg"
    for path in (inner, outer):
        path.write_bytes(b"old")
    files = RewrittenFiles()
    files.outdated("a", inner)
    files.outdated("a", outer)
    files.outdated("a", folder / "gone.jpg")
    files.remove_outdated(folder, lambda state: [])
    assert (inner.exists(), outer.exists()) == (False, True)
    inner.write_bytes(b"new")
    files.remove_outdated(folder, lambda state: [])
    assert inner.exists()
    assert (files.first("b"), files.first("a")) == ("b", "a")
