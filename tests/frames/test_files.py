from __future__ import annotations

import os
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import DamagedFile, Frame
from tests.frames.image_files import encoded, photographed, with_exif

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
    given = frames_in(tmp_path)
    assert given.count == 5
    assert given.order == "5 frames in the order of their names"
    assert [frame.name for frame in given.frames] == [
        "99/IMG_2.jpg",
        "100/IMG_1.jpg",
        "IMG_9.jpg",
        "IMG_10.jpg",
        "IMG_0011.jpg",
    ]


def photograph(path: Path, second: int, fraction: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(with_exif(JPEG, photographed(b"2021:06:05 14:03:%02d\0" % second, fraction.encode())))
    return path


def test_numbers_count_as_numbers_and_no_two_names_are_alike(tmp_path: Path) -> None:
    names = [str(n) for n in range(1, 120)] + ["1a", "a1b2", "a1b10", "a01b2", f"a{10**30}", f"a{10**31}", "b"]
    fill(tmp_path, *(f"{name}.jpg" for name in reversed(names)))
    found = [frame.name.removesuffix(".jpg") for frame in frames_in(tmp_path).frames]
    assert found[:2] == ["1", "1a"]
    assert [name for name in found if name.isdecimal()] == [str(n) for n in range(1, 120)]
    assert found[-6:] == ["a01b2", "a1b2", "a1b10", f"a{10**30}", f"a{10**31}", "b"]


def test_capture_times_come_before_names_over_all_folders(tmp_path: Path) -> None:
    for name, second, fraction in (("b/1", 3, ""), ("a/2", 1, ""), ("a/3", 2, "75"), ("b/4", 2, "25")):
        photograph(tmp_path / f"{name}.jpg", second, fraction)
    given = frames_in([tmp_path / "a", tmp_path / "b"])
    assert given.order == "4 frames in the order of their capture times (EXIF)"
    assert [frame.name for frame in given.frames] == ["2.jpg", "4.jpg", "3.jpg", "1.jpg"]


def test_where_one_frame_has_no_capture_time_names_decide(tmp_path: Path) -> None:
    photograph(tmp_path / "a" / "2.jpg", 1)
    photograph(tmp_path / "a" / "1.jpg", 5)
    fill(tmp_path / "b", "3.jpg")
    given = frames_in([tmp_path / "b", tmp_path / "a"])
    assert [frame.name for frame in given.frames] == ["3.jpg", "1.jpg", "2.jpg"]
    assert given.order == "3 frames in the order of their names (3.jpg tells no capture time)"
    given = frames_in([tmp_path / "a", tmp_path / "b"])
    assert [frame.name for frame in given.frames] == ["1.jpg", "2.jpg", "3.jpg"]
    assert given.order == "3 frames in the order of their names (3.jpg tells no capture time)"


def test_two_frames_in_one_second_leave_it_to_the_names(tmp_path: Path) -> None:
    """Two frames a second by a clock that knows whole seconds: the times cannot tell which came first."""
    for name, second in (("10", 5), ("9", 5), ("1", 9)):
        photograph(tmp_path / f"{name}.jpg", second)
    given = frames_in(tmp_path)
    assert [frame.name for frame in given.frames] == ["1.jpg", "9.jpg", "10.jpg"]
    assert given.order == "3 frames in the order of their names (9.jpg and 10.jpg have the same capture time)"


def test_what_could_not_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(tmp_path, "a.jpg", "closed/b.jpg")
    (tmp_path / "c.tif").write_bytes(photographed(b"2021:06:05 14:03:01\0")[:-1])
    listing = os.scandir

    def refusing(folder: str | Path) -> object:
        if str(folder).endswith("closed"):
            raise PermissionError(13, "Permission denied")
        return listing(folder)

    monkeypatch.setattr(os, "scandir", refusing)
    given = frames_in(tmp_path)
    assert given.count == 2
    assert given.passed_over == (f"{tmp_path / 'closed'} cannot be looked at (Permission denied): it is passed over",)
    assert given.notes == ("c.tif: when it was taken cannot be read: damaged: EXIF points beyond its end",)


def test_files_come_in_the_order_given(tmp_path: Path) -> None:
    paths = fill(tmp_path, "b.jpg", "a.jpg", "sub/a.jpg")
    assert frames_in(paths).order == "3 frames in the order given"
    assert [frame.name for frame in frames_in(paths).frames] == ["b.jpg", "a.jpg", "a.jpg#2"]


def test_a_damaged_file_is_said_and_the_rest_goes_on(tmp_path: Path) -> None:
    fill(tmp_path, "a.jpg", "b.jpg")
    (tmp_path / "a.jpg").write_bytes(JPEG[:100])
    assert [type(item) for item in frames_in(tmp_path).frames] == [DamagedFile, Frame]


def test_a_file_that_goes_while_frames_are_read_is_said(tmp_path: Path) -> None:
    first, second = fill(tmp_path, "a.jpg", "b.jpg")
    frames = frames_in([first, second]).frames
    assert isinstance(next(frames), Frame)
    second.unlink()
    assert isinstance(next(frames), DamagedFile)


def test_of_a_flight_it_is_said_where_its_frames_are(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    fill(tmp_path / "frames", "a.jpg")
    (tmp_path / "flight.sqlite").touch()
    with pytest.raises(UsageError, match=rf"is a flight.*give '{tmp_path}/frames'"):
        frames_in(tmp_path)
    assert frames_in(tmp_path / "frames").count == 1


def test_a_lock_that_was_left_hides_what_lies_below_a_map_but_no_folder_that_was_named(tmp_path: Path) -> None:
    fill(tmp_path, "a.jpg")
    (tmp_path / "map").mkdir()
    fill(tmp_path / "map", "tile.jpg")
    for folder in (tmp_path, tmp_path / "map"):
        (folder / ".gcs-mosaic.lock").touch()
    assert [frame.name for frame in frames_in(tmp_path).frames] == ["a.jpg"]


def test_nothing_to_read_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no images"):
        frames_in(tmp_path)
    with pytest.raises(UsageError, match="No such file"):
        frames_in([tmp_path / "none.jpg"])
