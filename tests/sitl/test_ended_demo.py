"""Whoever ends the demo ends the program that it has started."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from sitl.flight import Flight
from tests.running import until


@pytest.mark.long
def test_a_service_manager_that_ends_the_demo_leaves_nothing(flight: Flight, tmp_path: Path) -> None:
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    (photos / "0.jpg").write_bytes(flight.scene.encoded(flight.states[0], 0))
    words = ["demo", "--frames", str(photos), "--interval", "0.1", "--stay", "--http", "127.0.0.1:0"]
    command = [sys.executable, "-m", "gcs_mosaic", *words, "--out", str(out), "--watch", str(tmp_path / "watch")]
    demo = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until(lambda: (out / "status.json").exists(), "the program runs")
    children = psutil.Process(demo.pid).children(recursive=True)
    assert children
    demo.send_signal(signal.SIGTERM)
    demo.wait(60)
    _, left = psutil.wait_procs(children, timeout=10)
    for one in left:
        one.kill()
    assert not left
