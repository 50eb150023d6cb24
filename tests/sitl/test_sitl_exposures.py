from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sitl.exposures import LONGEST_PAUSE, USUAL_INTERVAL, recorded, simulated
from sitl.flight import Flight
from sitl.messages import position
from tests.sitl.sitl_parts import photograph, photograph_at


def photographs(folder: Path, seconds: list[int]) -> Path:
    for k, second in enumerate(seconds):
        path = folder / f"IMG_{k:04d}.jpg"
        path.write_bytes(photograph(date=b"2021:06:05 14:%02d:%02d\0" % divmod(second, 60)))
    return folder


def test_recorded_frames_come_in_name_order_unchanged(tmp_path: Path) -> None:
    for name in ("b/2.JPG", "a.png", "b/10.JPG", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(name.encode())
    film = recorded(tmp_path, interval=0.5)
    frames = list(film.exposures())
    assert [frame.name for frame in frames] == ["a.png", "b/10.JPG", "b/2.JPG"]
    assert [frame.data.decode() for frame in frames] == [frame.name for frame in frames]
    assert [frame.time for frame in frames] == [0, 0.5, 1.0]
    assert film.seconds == 1.0


def test_times_are_those_of_the_photographs(tmp_path: Path) -> None:
    film = recorded(photographs(tmp_path, [10, 12, 12, 15]))
    assert [frame.time for frame in film.exposures()] == [0, 2, 2, 5]
    assert "EXIF" in film.note


def test_a_photograph_s_own_place_is_what_the_vehicle_tells(tmp_path: Path) -> None:
    for k, place in enumerate([(-33.9, -179.9999, 20.0), (38.5, 179.9999, 700.0)]):
        (tmp_path / f"{k}.jpg").write_bytes(photograph_at(*place))
    (tmp_path / "2.jpg").write_bytes(photograph())
    told = [position(frame.state) for frame in recorded(tmp_path, interval=1.0).exposures()]
    assert [(latitude, longitude) for latitude, longitude, *_ in told] == [
        (-339000000, -1799999000),
        (385000000, 1799999000),
        (0, 0),
    ]
    assert [over_sea for _, _, over_sea, _ in told] == pytest.approx([20.0, 700.0, 0.0])


def test_a_rest_is_shortened_and_a_clock_set_back_is_no_trouble(tmp_path: Path) -> None:
    film = recorded(photographs(tmp_path, [10, 1810, 1500]))
    assert [frame.time for frame in film.exposures()] == [0, LONGEST_PAUSE, LONGEST_PAUSE + USUAL_INTERVAL]


def test_without_all_times_a_usual_interval_is_taken_and_said(tmp_path: Path) -> None:
    (photographs(tmp_path, [10, 12]) / "IMG_9999.jpg").write_bytes(b"\xff\xd8\xff\xd9")
    film = recorded(tmp_path)
    assert [frame.time for frame in film.exposures()] == [0, USUAL_INTERVAL, 2 * USUAL_INTERVAL]
    assert "not all tell" in film.note


def test_an_empty_folder_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no pictures"):
        recorded(tmp_path)


def test_a_simulated_film_is_the_flight(flight: Flight) -> None:
    film = simulated(flight)
    first = next(film.exposures())
    assert film.count == len(flight.states)
    assert film.seconds == flight.states[-1].time
    assert (first.name, first.state, first.time) == (flight.names[0], flight.states[0], 0)
    assert first.data == flight.scene.encoded(flight.states[0], 0)


def test_an_interval_overrides_the_route(flight: Flight) -> None:
    times = [frame.time for frame in simulated(flight, interval=0.25).exposures()]
    assert np.allclose(np.diff(times), 0.25)
