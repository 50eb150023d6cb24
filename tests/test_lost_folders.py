"""Real flights that lose their folder, are killed, and keep what they write to themselves; every way to lose a folder:
tests/benchmarks/lost_folders.py, every write that can fail: tests/benchmarks/failing_writes.py."""

from __future__ import annotations

import os
import stat
import sys
import time
from pathlib import Path

import pytest

from gcs_mosaic.store.folder import LEDGER_NAME
from tests.benchmarks.lost_folders import deleted, flown
from tests.running import flying, frames_of, until


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="a folder in use cannot be deleted")
def test_a_flight_whose_folder_is_deleted_ends_whole(tmp_path: Path, pictures: list[bytes]) -> None:
    said, _ = flown(tmp_path, deleted, pictures)
    assert said.count("the folder was deleted; everything is written anew from memory") == 1


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX modes")
def test_a_killed_flight_has_told_all_it_knew_and_nobody_else_can_read_it(
    tmp_path: Path, pictures: list[bytes]
) -> None:
    """Killed while frames wait, which mosaic.json tells of."""
    umask = os.umask(0o022)
    try:
        with flying(tmp_path, "--record") as flight:
            for number, picture in enumerate(pictures):
                flight.take(f"IMG_{number}.JPG", picture)
            until(lambda: len(known(flight.out)) == len(pictures), "all have come")
            time.sleep(0.3)
            flight.process.kill()
            flight.process.wait()
    finally:
        os.umask(umask)
    assert sum(flight.document("mosaic.json")["frames"].values()) == len(frames_of(flight.out)) == len(pictures)
    open_to_others = [path for path in flight.out.rglob("*") if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)]
    assert open_to_others == []
    assert {path.suffix for path in flight.out.rglob("*")} >= {".sqlite", ".tlog", ".log", ".JPG", ".json"}
    assert stat.S_IMODE(flight.out.stat().st_mode) == 0o700


def known(out: Path) -> dict[str, object]:
    return dict(frames_of(out)) if (out / LEDGER_NAME).exists() else {}
