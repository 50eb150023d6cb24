"""The simulated camera streams into a real server, and the real program takes its frames from there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import sitl.stream.camera
from sitl.__main__ import main
from sitl.stream.camera import NEEDED, python_with_gstreamer
from tests.sure import sure

FLY = ["--rtsp", "--count", "5", "--size", "640x480", "--interval", "0.8", "--no-http"]


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.skipif(python_with_gstreamer() is None, reason=f"needs GStreamer: apt-get install {NEEDED}")
def test_every_picture_of_a_flight_is_taken_from_the_stream(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, world_cache: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(world_cache))
    out = tmp_path / "mosaic"
    assert main([*FLY, "--watch", str(tmp_path / "frames"), "--out", str(out)]) == 0
    said = capfd.readouterr().out
    flown = int(sure(re.search(r"flying (\d+) pictures", said))[1])
    assert f"frames: placed {flown}; events: matched {flown}" in said
    assert len(list((out / "frames" / "stream").iterdir())) == flown
    assert not (tmp_path / "frames").exists()


def test_without_gstreamer_it_is_said_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sitl.stream.camera, "python_with_gstreamer", lambda: None)
    assert main([*FLY, "--out", str(tmp_path / "mosaic")]) == 2
    assert "apt-get install gir1.2-gst-rtsp-server-1.0" in capsys.readouterr().out
