"""Folders whose names or sizes look like several cameras, and are of one: every file is a frame, in its order.

In the field: pictures turned by hand, two aircraft called red and blue, pictures retaken, sequences saved as TIFF.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from gcs_mosaic.frames.cameras import HOLD_S, Cameras
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.frames.previews import WAIT_S
from gcs_mosaic.messages import Frame
from tests.frames.image_files import encoded, photographed, picture, with_exif
from tests.frames.test_cameras import Arriving, frame
from tests.frames.test_directory import Watched

LYING, UPRIGHT, WIDE = (160, 120), (120, 160), (160, 90)
Shot = tuple[str, tuple[int, int], int | None]  # name, size in px, capture time in s


def flights(names: str, first_s: Iterable[int], pauses_s: Iterable[int]) -> list[Shot]:
    """Flights one after another whose pictures are counted alike."""
    given = zip(names.split(), first_s, pauses_s, strict=True)
    return [(name.format(k), LYING, first + pause * k) for name, first, pause in given for k in range(1, 9)]


FLIGHTS: dict[str, list[Shot]] = {
    "lying and upright in turn": [(f"IMG_{k:04}.jpg", UPRIGHT if k % 2 else LYING, None) for k in range(12)],
    "two shapes in turn": [(f"IMG_{k:04}.jpg", WIDE if k % 2 else LYING, None) for k in range(12)],
    "two aircraft by colour": flights("red_{:04}.jpg blue_{:04}.jpg", (0, 600), (2, 4)),
    "two aircraft's folders": flights("red/DJI_{:04}.jpg blue/DJI_{:04}.jpg", (0, 600), (2, 4)),
    "two aircraft at the same time": [
        (f"{name}/DJI_{k:04}.jpg", LYING, 2 * k + (k // 3 if name == "blue" else 0))
        for name in ("red", "blue")
        for k in range(15)
    ],
    "two lenses, two flights": flights("wide_{:03}.jpg zoom_{:03}.jpg", (0, 900), (3, 5)),
    "the day's and the night's flight": flights("DJI_{:04}_W.jpg DJI_{:04}_T.jpg", (0, 9000), (3, 3)),
    "retaken": flights("IMG_{:04}.jpg IMG_{:04}_R.jpg", (0, 6), (20, 20)),
    "four directions": flights("{:03}_N.jpg {:03}_E.jpg {:03}_S.jpg {:03}_W.jpg", (0, 6, 12, 18), (40,) * 4),
    "a sequence of a few TIFFs": [(f"flight_0001_{k}.tif", LYING, None) for k in range(1, 6)],
    "a sequence with zeros": [(f"flight_0001_{k:02}.tif", LYING, None) for k in range(1, 30)],
    "a sequence of JPEGs": [(f"flight1_{k}.jpg", LYING, None) for k in range(1, 6)],
}


@cache
def file(name: str, size: tuple[int, int], seconds: int | None, seed: int) -> bytes:
    data = encoded(Path(name).suffix, picture(*size, seed=seed))
    date = (
        b"" if seconds is None else b"2021:06:05 %02d:%02d:%02d\0" % (seconds // 3600, seconds // 60 % 60, seconds % 60)
    )
    return with_exif(data, photographed(date)) if date else data


@pytest.mark.parametrize("shots", FLIGHTS.values(), ids=FLIGHTS.keys())
def test_every_file_of_a_folder_is_a_frame(tmp_path: Path, shots: list[Shot]) -> None:
    for seed, (name, size, seconds) in enumerate(shots):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(file(name, size, seconds, seed))
    assert sorted(frame.name for frame in frames_in(tmp_path).frames) == sorted(name for name, *_ in shots)


@pytest.mark.parametrize("shots", FLIGHTS.values(), ids=FLIGHTS.keys())
def test_every_file_that_comes_is_a_frame(tmp_path: Path, shots: list[Shot]) -> None:
    watched = Watched(tmp_path)
    watched.look()
    names = list[str]()
    for seed, (name, size, seconds) in enumerate(shots):
        watched.write(name, file(name, size, seconds, seed))
        names += watched.names(6)
    names += watched.names(12)
    assert names == [name for name, *_ in shots]


def test_a_camera_that_takes_two_pictures_a_second_keeps_their_order_at_the_first() -> None:
    arriving = Arriving()
    names = [f"DJI_{k:04}_W.JPG" for k in range(1, 12)]
    for name in names:
        arriving.shot([name], pause_s=0.0, apart_s=0.5)
    assert arriving.frames == names


def test_numbers_beyond_those_of_bands_bring_back_what_was_taken_for_bands() -> None:
    arriving = Arriving()
    names = [f"flight_0001_{k}.tif" for k in range(1, 20)]
    for name in names:
        arriving.shot([name], pause_s=0.0, apart_s=0.3)
    arriving.wait(HOLD_S)
    assert sorted(arriving.frames) == sorted(names)


def test_times_that_go_on_bring_back_what_was_taken_for_bands() -> None:
    """Two pictures a second, whose times are whole seconds: the first four may be bands."""
    cameras, names, frames = Cameras(), [f"flight_0001_{k}.tif" for k in range(1, 7)], list[str]()
    for k, name in enumerate(names):
        come = replace(frame(name), captured=float(k // 2), received=0.5 * k)
        items = [*cameras.take(come, None, 0.5 * k), *cameras.due(0.5 * k + 0.5)]
        frames += [item.name for item in items if isinstance(item, Frame)]
    frames += [item.name for item in cameras.due(9.0) if isinstance(item, Frame)]
    assert sorted(frames) == names
    assert cameras.left_out == 0


def test_a_flight_of_the_other_camera_alone_that_counts_anew_is_not_left_out(tmp_path: Path) -> None:
    """What the thermal camera alone has seen would be missing on the map; it is mapped, for it has seen all."""
    for seed, (hour, cameras) in enumerate(((10, "WT"), (14, "T"))):
        for k in range(1, 9):
            for camera in cameras:
                path = tmp_path / f"DJI_20230101{hour}00{k:02}_{k:04}_{camera}.JPG"
                path.write_bytes(file("a.jpg", LYING, hour * 3600 + k, seed))
    assert [frame.name[-5] for frame in frames_in(tmp_path).frames] == ["T"] * 16


def test_smaller_pictures_from_now_on_wait_once(tmp_path: Path) -> None:
    """The operator has switched to video stills: they are no previews."""
    watched = Watched(tmp_path)
    watched.write("a.jpg", encoded(".jpg", picture(320, 240)))
    assert watched.names() == ["a.jpg"]
    names = [f"b{k}.jpg" for k in range(4)]
    for seed, name in enumerate(names):
        watched.write(name, file(name, WIDE, None, seed))
        assert watched.names() == []
    watched.now += WAIT_S - 1.0
    assert watched.names() == names
    watched.write("c.jpg", file("c.jpg", WIDE, None, 9))
    assert watched.names() == ["c.jpg"]


def test_one_name_written_again_and_again_in_a_smaller_size_loses_nothing(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    pictures, frames = [(LYING, 0), *(((60, 45), seed) for seed in range(1, 5))], list[Frame]()
    for size, seed in pictures:
        watched.write("latest.jpg", file("latest.jpg", size, None, seed))
        frames += [item for item in watched.look(4) if isinstance(item, Frame)]
    assert [frame.name for frame in frames] == ["latest.jpg", *(f"latest.jpg#{k}" for k in range(2, 6))]
    assert [frame.earlier for frame in frames[1:]] == [frame.name for frame in frames[:-1]]
    assert not any(frame.is_whole_of_earlier for frame in frames)


@pytest.mark.parametrize("small", [[(LYING, 0, None), (LYING, 1, None)], [(LYING, 0, 7)]], ids=["again", "other time"])
def test_a_larger_picture_under_a_name_that_is_written_again_replaces_nothing(
    tmp_path: Path, small: list[tuple[tuple[int, int], int, int | None]]
) -> None:
    watched, frames = Watched(tmp_path), list[Frame]()
    for size, seed, seconds in [*small, ((320, 240), 2, 9)]:
        watched.write("latest.jpg", file("latest.jpg", size, seconds, seed))
        frames += [item for item in watched.look(4) if isinstance(item, Frame)]
    assert [frame.is_whole_of_earlier for frame in frames] == [False] * (len(small) + 1)
