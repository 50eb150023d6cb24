"""The real program is flown elsewhere; here a small stand-in behaves well or badly on demand."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest

import sitl.program
from sitl.program import Program, ProgramError, processed

STAND_IN = """
import json, pathlib, signal, sys, time
out, manner = pathlib.Path(sys.argv[1]), sys.argv[2]
signal.signal(signal.SIGTERM, signal.SIG_IGN if manner == "deaf" else lambda *_: sys.exit(0))
if manner == "dies": sys.exit(3)
out.mkdir()
if manner != "mute": (out / "status.json").write_text("{}")
for placed in range(4):
    beside = out / "beside"
    beside.write_text(json.dumps({"frames": {"pending": 3 - placed, "placed": placed}, "events": {"matched": placed}}))
    beside.rename(out / "mosaic.json")
    time.sleep(0.15)
    if manner == "gives up" and placed == 1: sys.exit(4)
    while manner == "stalls": time.sleep(0.1)
time.sleep(60)
"""


def stand_in(folder: Path, manner: str) -> Program:
    program = Program(14550, folder / "frames", folder / "mosaic", None)
    command = [sys.executable, "-c", STAND_IN, str(program.out), manner]
    patch.object(Program, "command", lambda self: command).start()
    return program


@pytest.fixture(autouse=True)
def _short_waits() -> Iterator[None]:
    with patch.multiple(sitl.program, START_TIMEOUT=20.0, STALL_TIMEOUT=2.0, STOP_TIMEOUT=1.0):
        yield
    patch.stopall()


def test_the_command_is_what_an_operator_types() -> None:
    page, none = (Program(14600, Path("w"), Path("o"), http).command()[1:] for http in ("127.0.0.1:8470", None))
    common = ["-m", "gcs_mosaic", "--mavlink", "udp:127.0.0.1:14600", "--watch", "w", "--out", "o", "--new"]
    assert page == [*common, "--http", "127.0.0.1:8470"]
    assert none == [*common, "--no-http"]


def test_a_good_program_is_followed_to_the_end(tmp_path: Path) -> None:
    program, said, ticks = stand_in(tmp_path, "good"), [], []
    program.start()
    program.wait_for(3, lambda account: said.append(account["placed"]), lambda: ticks.append(1))
    assert ticks
    assert said[-1] == 3
    assert said == sorted(said)
    assert program.account("events") == {"matched": 3}
    assert program.stop() == 0


@pytest.mark.long
@pytest.mark.parametrize(("manner", "sentence"), [("dies", "exit code 3"), ("mute", r"wrote no .*status\.json within")])
def test_one_that_does_not_start_is_told(manner: str, sentence: str, tmp_path: Path) -> None:
    program = stand_in(tmp_path, manner)
    with patch.object(sitl.program, "START_TIMEOUT", 1.0), pytest.raises(ProgramError, match=sentence):
        program.start()
    program.stop()


@pytest.mark.long
@pytest.mark.parametrize(
    ("manner", "sentence"), [("gives up", "exit code 4"), ("stalls", "0 of 3 pictures, then nothing")]
)
def test_one_that_does_not_finish_is_told(manner: str, sentence: str, tmp_path: Path) -> None:
    program = stand_in(tmp_path, manner)
    program.start()
    with pytest.raises(ProgramError, match=sentence):
        program.wait_for(3, lambda account: None, lambda: None)
    program.stop()


@pytest.mark.long
def test_one_that_does_not_end_is_killed_and_told(tmp_path: Path) -> None:
    program = stand_in(tmp_path, "deaf")
    program.start()
    with pytest.raises(ProgramError, match="was killed"):
        program.stop()
    assert program.process is not None
    assert program.process.poll() == -9


def test_pending_frames_are_not_worked_off() -> None:
    assert processed({"pending": 4, "placed": 2, "rejected": 1}) == 3
    assert processed({}) == 0


def test_before_there_is_a_mosaic_the_accounts_are_empty(tmp_path: Path) -> None:
    assert Program(1, tmp_path, tmp_path, None).account("frames") == {}
    (tmp_path / "mosaic.json").write_text("[]")
    assert Program(1, tmp_path, tmp_path, None).account("frames") == {}
