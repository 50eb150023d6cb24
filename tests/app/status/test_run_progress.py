"""How far a command is, for whoever looks: at its pipe, or from elsewhere."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import pytest
from rich.console import Console

from gcs_mosaic.app.status import run_progress
from gcs_mosaic.app.status.run_progress import RunProgress
from gcs_mosaic.cli.main import main
from gcs_mosaic.store import progress as progress_file
from gcs_mosaic.store.folder import PROGRESS_NAME, occupied
from gcs_mosaic.store.status import read_status
from gcs_mosaic.store.told_documents import ProgressDocument
from tests.documents import misfits
from tests.running import until


@pytest.fixture(autouse=True)
def _quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_progress, "LINE_EACH_S", 0.02)
    monkeypatch.setattr(progress_file, "EACH_S", 0.02)


def test_a_pipe_is_told_how_far_it_is_though_nothing_moves(tmp_path: Path) -> None:
    said = io.StringIO()
    with RunProgress(Console(file=said, width=300)) as progress:
        task = progress.add_task("stitching [a].jpg", total=95)
        progress.update(task, completed=12)
        until(lambda: said.getvalue().count("stitching [a].jpg: 12 of 95") > 1, "two lines")
        progress.add_task("final painting", total=None)
        until(lambda: "final painting: 0\n" in said.getvalue(), "what is counted without an end")
    before = said.getvalue()
    time.sleep(0.1)
    assert said.getvalue() == before


def test_a_running_command_is_told_of_from_elsewhere_and_its_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with RunProgress(Console(quiet=True)) as progress, progress.kept_in(tmp_path, "stitch"):
        task = progress.add_task("stitching a.jpg", total=95)
        progress.update(task, completed=12)
        told = until(lambda: "12 of 95" in read_status(tmp_path) and read_status(tmp_path), "it is told")
        assert told.startswith("stitch: running, begun ")
        assert misfits(ProgressDocument, json.loads((tmp_path / PROGRESS_NAME).read_text())) == []
        assert occupied(tmp_path), "another's start does not write here"
        hung = read_status(tmp_path, now_utc=time.time() + 100)
        assert "the program was killed or hangs" in hung
    assert main(["status", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("stitch: ended, begun ")
    assert json.loads(read_status(tmp_path, as_json=True))["state"] == "ended"


def failing(folder: Path) -> None:
    with RunProgress(Console(quiet=True)) as progress, progress.kept_in(folder, "stitch"):
        assert (folder / PROGRESS_NAME).is_file()
        raise RuntimeError


def test_a_command_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError):
        failing(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_lost_stops_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "lost"
    with RunProgress(Console(quiet=True)) as progress, progress.kept_in(folder, "replay"):
        progress.add_task("flying", total=1)
    assert not folder.exists()
