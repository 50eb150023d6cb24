"""Whoever ends the demo ends the program that it has started."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import psutil
import pytest

from sitl.__main__ import interrupt
from sitl.flight import Flight
from sitl.session import ENDING, go_on
from sitl.vehicle import Vehicle
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


def test_an_end_that_the_code_of_others_has_caught_is_not_forgotten() -> None:
    """As a bare `except` around an import does: the demo stayed until it was killed."""
    told: list[None] = []
    vehicle = Mock(Vehicle, tick=told.append)
    go_on(vehicle)
    with suppress(KeyboardInterrupt):
        interrupt(signal.SIGTERM, None)
    try:
        with pytest.raises(KeyboardInterrupt):
            go_on(vehicle)
    finally:
        ENDING.clear()
    assert told == [None]
