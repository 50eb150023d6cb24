"""How far an archive is: for a terminal, a pipe, a program, and for whoever asks for the status."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from gcs_mosaic.archive.progress import Lines, StageCost
from gcs_mosaic.store.status import read_status


def run(lines: Lines, now: list[float]) -> None:
    """A stage of 60 tasks, one each second."""
    cost = StageCost("features", 60)
    lines.begin(cost)
    for second in range(1, 61):
        now[0] = float(second)
        cost.add(0.5)
        lines.advance(cost.at(now[0]))
    lines.end(cost)


def test_a_pipe_has_a_line_each_ten_seconds_and_one_for_each_stage() -> None:
    said, now = io.StringIO(), [0.0]
    run(Lines(Console(file=said, width=100), now=lambda: now[0]), now)
    counts = [line.split(" of ")[0] for line in said.getvalue().splitlines()]
    assert counts == [
        "features: 10",
        "features: 20",
        "features: 30",
        "features: 40",
        "features: 50",
        "features: 60 in 60.0 s",
    ]


def test_a_terminal_has_one_line_that_is_written_over() -> None:
    screen, now = io.StringIO(), [0.0]
    run(Lines(Console(file=screen, force_terminal=True, width=100, color_system=None), now=lambda: now[0]), now)
    assert screen.getvalue().count("\n") == 1
    assert screen.getvalue().endswith("\r\x1b[2Kfeatures: 60 in 60.0 s\n")


def test_a_program_has_a_line_of_json_each_second(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    run(Lines(Console(quiet=True), as_json=True, now=lambda: now[0]), now)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["done"] for one in told] == list(range(1, 61))
    assert [one["state"] for one in told[-2:]] == ["running", "done"]


def test_its_status_is_told_before_there_is_a_map(tmp_path: Path) -> None:
    now = [0.0]
    lines = Lines(Console(quiet=True), now=lambda: now[0])
    with lines.kept_in(tmp_path):
        assert "starting: 0" in read_status(tmp_path)
        run(lines, now)
    assert read_status(tmp_path).startswith("reprocess: ended")
    assert json.loads(read_status(tmp_path, as_json=True))["done"] == 60
