"""Exports are whole or not there: with a full disk, another export into the same file, and after one that was killed."""

from __future__ import annotations

import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.whole_file import whole_file, whole_folder
from tests.geotiles.ground import anchor
from tests.notes.written_pins import write_pins
from tests.web.maps.anchored_flight import PINNED, AnchoredFlight

HOLDS_IT = """
import sys, time
from pathlib import Path
from gcs_mosaic.export.whole_file import whole_file, whole_folder
how = whole_file if sys.argv[1] == "file" else whole_folder
with how(Path(sys.argv[2])) as beside:
    (beside if sys.argv[1] == "file" else beside / "half").write_text("half")
    print("half", flush=True)
    time.sleep(600)
"""
SMALL_DISK = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
from gcs_mosaic.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_of_two_exports_into_one_place_the_second_is_refused(tmp_path: Path, kind: str) -> None:
    """And leaves alone what the first writes; after one that was killed the next goes on."""
    target, how = tmp_path / "map", whole_file if kind == "file" else whole_folder
    first = subprocess.Popen([sys.executable, "-c", HOLDS_IT, kind, str(target)], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    assert first.stdout.readline() == "half\n"
    with pytest.raises(UsageError, match="is being written by another export"), how(target):
        pass
    assert hidden(tmp_path) == [".map.part"]
    assert not target.exists()
    first.send_signal(signal.SIGKILL)
    first.wait()
    first.stdout.close()
    with how(target) as beside:
        assert not any(beside.iterdir()) if kind == "folder" else beside.stat().st_size == 0
        assert not target.exists()
    assert target.exists()
    assert hidden(tmp_path) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_what_ends_an_export_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "map").write_text("old")

    def ends() -> None:
        with whole_file(tmp_path / "map") as beside:
            beside.write_text("half")
            raise error

    with pytest.raises(error):
        ends()
    assert (tmp_path / "map").read_text() == "old"
    assert hidden(tmp_path) == []


@pytest.mark.long
def test_a_full_disk_is_told_in_a_sentence(tmp_path: Path) -> None:
    """By SQLite's errors too."""
    root = tmp_path / "small"
    root.mkdir()
    made = AnchoredFlight(root, anchor(gsd_m=0.1))
    write_pins(root, [(x, y, *made.truth.places(np.array([x, y])).tolist()) for x, y in PINNED])
    target = tmp_path / "map.mbtiles"
    command = [sys.executable, "-c", SMALL_DISK, "export", str(root), "--format", "mbtiles", "--to", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 2, done.stderr
    assert "cannot be written" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not target.exists()
    assert hidden(tmp_path) == []
    assert main(["export", str(root), "--format", "mbtiles", "--to", str(target)]) == 0
    with closing(sqlite3.connect(target)) as file:
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
