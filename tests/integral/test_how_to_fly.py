"""What the calculator says gives the looks that were wanted, counted anew."""

import re

import pytest

from gcs_mosaic.cli.main import main


@pytest.mark.parametrize("looks", [3, 5, 20, 30])
def test_what_it_says_gives_the_looks_that_were_wanted(looks: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["looks", str(looks), "--flown", "50", "--fov", "90", "--aspect", "1.25"]) == 0
    step, spacing = map(float, re.findall(r"([\d.]+) m a", capsys.readouterr().out)[:2])
    long, short = 100.0, 80.0  # metres, of 90 degrees at 50 m
    along = int(short / step + 0.05)
    across = int(long / spacing + 0.05)
    assert along * across >= looks


def test_motion_blur_bounds_the_speed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["looks", "5", "--pixels", "1000", "--fov", "90", "--flown", "50", "--exposure", "0.1"]) == 0
    assert "at most 0.5 m/s, by motion blur" in capsys.readouterr().out  # half of 0.1 m in 0.1 s


@pytest.mark.parametrize("words", [["1"], ["5", "--fov", "170"], ["5", "--pixels", "3"]])
def test_what_no_camera_does_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["looks", *words]) == 2
    assert "Give two looks or more" in capsys.readouterr().err
