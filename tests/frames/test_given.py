from __future__ import annotations

from pathlib import Path

import pytest
from image_files import encoded

from gcs_mosaic.errors import UsageError
from gcs_mosaic.events import DamagedFile, Frame
from gcs_mosaic.frames.directory import frames_in

JPEG = encoded(".jpg")


def fill(folder: Path, *names: str) -> list[Path]:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(JPEG)
    return [folder / name for name in names]


def test_a_folder_is_read_in_the_order_of_its_names(tmp_path: Path) -> None:
    fill(
        tmp_path, "IMG_10.jpg", "IMG_9.jpg", "IMG_0011.jpg", "100/IMG_1.jpg", "99/IMG_2.jpg", ".hidden.jpg", "notes.txt"
    )
    count, frames = frames_in(tmp_path)
    assert count == 5
    assert [frame.name for frame in frames] == [
        "99/IMG_2.jpg",
        "100/IMG_1.jpg",
        "IMG_9.jpg",
        "IMG_10.jpg",
        "IMG_0011.jpg",
    ]


def test_files_come_in_the_order_given(tmp_path: Path) -> None:
    paths = fill(tmp_path, "b.jpg", "a.jpg", "sub/a.jpg")
    assert [frame.name for frame in frames_in(paths)[1]] == ["b.jpg", "a.jpg", "a.jpg#2"]


def test_a_damaged_file_is_said_and_the_rest_goes_on(tmp_path: Path) -> None:
    fill(tmp_path, "a.jpg", "b.jpg")
    (tmp_path / "a.jpg").write_bytes(JPEG[:100])
    assert [type(item) for item in frames_in(tmp_path)[1]] == [DamagedFile, Frame]


def test_a_file_that_goes_while_frames_are_read_is_said(tmp_path: Path) -> None:
    first, second = fill(tmp_path, "a.jpg", "b.jpg")
    _, frames = frames_in([first, second])
    assert isinstance(next(frames), Frame)
    second.unlink()
    assert isinstance(next(frames), DamagedFile)


def test_nothing_to_read_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no images"):
        frames_in(tmp_path)
    with pytest.raises(UsageError, match="No such file"):
        frames_in([tmp_path / "none.jpg"])
