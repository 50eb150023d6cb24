"""Small copies of frames under the same name, in folders of any name: galleries, sync programs, an operator's own."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from gcs_mosaic.frames.files import frames_in
from tests.frames.image_files import encoded, photographed, picture, with_exif
from tests.frames.test_directory import Watched

LARGE, SMALL = (160, 120), (80, 60)


def jpeg(size: tuple[int, int], seconds: int | None, seed: int = 0) -> bytes:
    data = encoded(".jpg", picture(*size, seed=seed))
    return data if seconds is None else with_exif(data, photographed(b"2021:06:05 14:03:%02d\0" % seconds))


@pytest.mark.parametrize("times", [(None, None), (7, 7), (7, None)])
def test_they_are_left_out(tmp_path: Path, times: tuple[int | None, int | None]) -> None:
    watched = Watched(tmp_path)
    watched.write("A_1.jpg", jpeg(LARGE, times[0]))
    assert watched.names() == ["A_1.jpg"]
    watched.write("for the web site/A_1.JPG", jpeg(SMALL, times[1]))
    assert watched.names(40) == []
    given = frames_in(tmp_path)
    assert given.count == 1
    assert "for the web site/A_1.JPG" in given.passed_over[0]


OTHERS = {
    "another time": (SMALL, 8, 0.0),
    "much later": (SMALL, None, 600.0),
    "another shape": ((80, 45), 7, 0.0),
    "as large": (LARGE, 7, 0.0),
}


@pytest.mark.parametrize(("size", "seconds", "later_s"), OTHERS.values(), ids=OTHERS.keys())
def test_what_only_has_the_name_in_common_is_a_frame(
    tmp_path: Path, size: tuple[int, int], seconds: int | None, later_s: float
) -> None:
    """The counters of two cards begin with the same names."""
    watched = Watched(tmp_path)
    watched.write("100MEDIA/A_1.jpg", jpeg(LARGE, 7), age_s=later_s)
    assert watched.names() == ["100MEDIA/A_1.jpg"]
    watched.write("101MEDIA/A_1.jpg", jpeg(size, seconds, seed=1))
    assert watched.names(40) == ["101MEDIA/A_1.jpg"]
    assert frames_in(tmp_path).count == 2


def test_of_a_folder_it_is_all_the_same_which_comes_first(tmp_path: Path) -> None:
    for name, size in (("a/1.jpg", SMALL), ("b/1.jpg", LARGE)):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(jpeg(size, None))
        os.utime(tmp_path / name, (time.time(), time.time()))
    assert [frame.name for frame in frames_in(tmp_path).frames] == ["b/1.jpg"]
