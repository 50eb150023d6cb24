from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from unittest.mock import patch

import pytest

import sitl
from sitl.__main__ import MISUSED, main
from sitl.flight import Flight
from sitl.program import Program
from sitl.session import DONE, FAILED
from sitl.truth import read, write
from tests.ports import free_port
from tests.sitl.sitl_parts import Ground, placements

STAND_IN = """
import json, pathlib, signal, socket, sys, time
words = sys.argv[1:]
if words[0] == "export":
    pathlib.Path(words[words.index("--to") + 1]).write_text('{"frames": []}')
    sys.exit()
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
after = lambda word: words[words.index(word) + 1]
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.bind(("127.0.0.1", int(after("--mavlink").rsplit(":", 1)[1])))
out = pathlib.Path(after("--out"))
out.mkdir(parents=True)
(out / "status.json").write_text("{}")
while True:
    placed = sum(path.read_bytes()[-2:] == b"\\xff\\xd9" for path in pathlib.Path(after("--watch")).rglob("*.JPG"))
    beside = out / "beside"
    beside.write_text(json.dumps({"frames": {"placed": placed, "pending": 0}, "events": {"matched": placed}}))
    beside.rename(out / "mosaic.json")
    time.sleep(0.05)
"""


@pytest.fixture
def photos(tmp_path: Path, flight: Flight) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for k in range(3):
        (folder / f"{k}.jpg").write_bytes(flight.scene.encoded(flight.states[k], k))
    return folder


def test_it_judges_a_finished_flight_in_a_line(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(flight.truth(), tmp_path / "truth.json")
    (tmp_path / "placements.json").write_text(json.dumps(placements(flight.truth())))
    assert main(["score", str(tmp_path / "truth.json"), str(tmp_path / "placements.json")]) == DONE
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("placed 12/12 alone 0 islands 1")
    assert "ortho rmse 0.0" in line


@pytest.mark.long
def test_it_flies_photographs_for_a_program_that_runs_already(photos: Path, tmp_path: Path) -> None:
    watch = tmp_path / "watch"
    words = ["--interval", "0.1", "--no-daemon", "--manner", "px4,ardupilot,camera"]
    with closing(Ground()) as ground:
        assert main([*words, "--frames", str(photos), "--watch", str(watch), "--port", str(ground.port)]) == DONE
        kinds = [message.get_msgId() for message in ground.heard()]
    assert (kinds.count(112), kinds.count(180), kinds.count(263)) == (3, 3, 6)
    assert all((watch / path.name).read_bytes() == path.read_bytes() for path in photos.iterdir())


@pytest.mark.long
def test_it_writes_the_truth_of_a_simulated_flight(tmp_path: Path) -> None:
    file = tmp_path / "t.json"
    words = ["--count", "2", "--size", "160x120", "--interval", "0.1", "--no-daemon", "--port", "9"]
    with patch.dict(os.environ, XDG_CACHE_HOME=str(tmp_path / "cache")):
        assert main([*words, "--watch", str(tmp_path / "w"), "--truth", str(file)]) == DONE
    assert [frame.name for frame in read(file).frames] == ["DCIM/100MEDIA/IMG_0001.JPG", "DCIM/100MEDIA/IMG_0002.JPG"]


@pytest.mark.long
def test_a_whole_flight_starts_the_program_flies_stops_it_and_judges_it(tmp_path: Path) -> None:
    """With a stand-in that counts files; the real program is flown in the tests of the whole."""
    (tmp_path / "gcs_mosaic").mkdir()
    (tmp_path / "gcs_mosaic/__init__.py").touch()
    (tmp_path / "gcs_mosaic/__main__.py").write_text(STAND_IN)
    words = [
        "--count",
        "3",
        "--size",
        "160x120",
        "--interval",
        "0.1",
        "--http",
        "127.0.0.1:1",
        "--port",
        str(free_port()),
    ]
    where = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(Path(sitl.__file__).parents[1])}
    command = [sys.executable, "-m", "sitl", *words]
    done = subprocess.run(command, cwd=tmp_path, env=where, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == DONE, done.stdout + done.stderr
    assert "page: http://127.0.0.1:1/" in done.stdout
    assert "frames: placed 3; events: matched 3" in done.stdout
    assert done.stdout.splitlines()[-2].startswith("sitl: against the truth: placed 0/3")


def test_a_folder_in_use_is_refused(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--frames", str(photos), "--out", str(photos), "--watch", str(tmp_path / "w")]) == MISUSED
    assert "is not an empty folder" in capsys.readouterr().out


def test_a_folder_without_pictures_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--frames", str(tmp_path)]) == MISUSED
    assert "there are no pictures" in capsys.readouterr().out


@pytest.mark.long
def test_targets_and_exposure_are_as_asked(tmp_path: Path) -> None:
    words = ["--count", "2", "--size", "160x120", "--interval", "0.1", "--no-daemon", "--port", "9"]
    looks = ["--people", "2", "--marks", "1", "--vignetting", "0.4", "--exposure-step", "2", "--step-every", "1"]
    with patch.dict(os.environ, XDG_CACHE_HOME=str(tmp_path / "cache")):
        assert main([*words, *looks, "--watch", str(tmp_path / "w"), "--truth", str(tmp_path / "t.json")]) == DONE
    truth = read(tmp_path / "t.json")
    assert [target.kind for target in truth.targets] == ["person", "person", "mark"]
    assert truth.vignetting == 0.4
    assert [frame.gain for frame in truth.frames] == [1, 0.5]


@pytest.mark.parametrize(
    "words",
    [
        ["--people", "-1"],
        ["--speed", "0"],
        ["--drop", "2"],
        ["--size", "9x9"],
        ["--manner", "dji"],
        ["--scenario", "x"],
        ["--count", "0"],
    ],
)
def test_bad_words_end_with_2(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2


def test_a_program_that_does_not_start_fails_the_flight(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with patch.object(Program, "command", lambda self: [sys.executable, "-c", "raise SystemExit(7)"]):
        assert main(["--frames", str(photos), "--interval", "0.1"]) == FAILED
    assert "exit code 7" in capsys.readouterr().out


@pytest.mark.long
def test_ctrl_c_ends_it_cleanly(photos: Path, tmp_path: Path) -> None:
    words = ["--frames", str(photos), "--interval", "30", "--no-daemon", "--watch", str(tmp_path / "w"), "--port", "9"]
    process = subprocess.Popen([sys.executable, "-m", "sitl", *words], stdout=subprocess.PIPE, text=True)
    while not (tmp_path / "w/0.jpg").exists():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=10)
    assert process.returncode == DONE
    assert said.splitlines()[-1] == "sitl: stopped"
