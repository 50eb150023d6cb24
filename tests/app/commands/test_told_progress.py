"""A piped `stitch` tells how far it is, and its folder tells it to others; so do a replay and a merge."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.app.commands.merging import merge
from gcs_mosaic.app.status import run_progress
from gcs_mosaic.store.status import read_status
from tests.settings import FEW_FEATURES


@pytest.mark.long
def test_a_piped_stitch_tells_how_far_it_is(
    pictures: list[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_progress, "LINE_EACH_S", 0.01)
    frames, said = tmp_path / "frames", io.StringIO()
    frames.mkdir()
    for number, data in enumerate(pictures[:3]):
        (frames / f"{number}.jpg").write_bytes(data)
    out = stitch([frames], tmp_path / "out", FEW_FEATURES, Console(file=said, width=200))
    assert " of 3" in said.getvalue().split("frames placed in")[0]
    assert "final painting: " in said.getvalue()
    lines = read_status(out).splitlines()
    assert lines[0].startswith("stitch: ended, begun ")
    assert lines[1] == "frames: 3 placed"
    other = Path(shutil.copytree(out, tmp_path / "other"))
    both = merge([out, other], tmp_path / "both", FEW_FEATURES, Console(quiet=True))
    assert read_status(both).startswith("merge: ended, begun ")
