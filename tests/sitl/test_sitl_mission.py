from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest

from sitl.delivery import Delivery, write_slowly
from sitl.exposures import Exposure, Film
from sitl.mission import fly
from sitl.vehicle import Vehicle
from tests.sitl.sitl_parts import Ground


def film(count: int = 5, interval: float = 0.2, slow: float = 0.0) -> Film:
    def exposures() -> Iterator[Exposure]:
        for k in range(count):
            time.sleep(slow if k == 1 else 0.0)
            yield Exposure(index=k, time=k * interval, name=f"DCIM/{k}.JPG", state=None, data=bytes([k]) * 10_000)

    return Film(count=count, seconds=(count - 1) * interval, note="", exposures=exposures)


def flown(made: Film, folder: Path, speed: float = 1.0, delay: float = 0.15) -> list[float]:
    """Fly with a real link; when each trigger was sent."""
    times: list[float] = []
    with closing(Ground()) as ground, closing(Vehicle("127.0.0.1", ground.port, ["camera"])) as vehicle:
        fly(made, vehicle, Delivery(folder, delay, 0.1), speed, lambda _: times.append(time.monotonic()))
        captured = [message for message in ground.heard() if message.get_type() == "CAMERA_IMAGE_CAPTURED"]
    assert [message.image_index for message in captured] == [k + 1 for k in range(made.count)]
    return times


def gaps(times: list[float]) -> list[float]:
    return [after - before for before, after in pairwise(times)]


@pytest.mark.long
def test_triggers_keep_their_times_and_every_file_arrives_whole(tmp_path: Path) -> None:
    times = flown(film(), tmp_path)
    assert min(gaps(times)) > 0.1
    assert 0.75 < times[-1] - times[0] < 2.5
    for k in range(5):
        assert (tmp_path / f"DCIM/{k}.JPG").read_bytes() == bytes([k]) * 10_000


@pytest.mark.long
def test_speed_shortens_the_flight(tmp_path: Path) -> None:
    times = flown(film(interval=1.0), tmp_path, speed=10)
    assert 0.35 < times[-1] - times[0] < 2.5


@pytest.mark.long
def test_late_pictures_delay_the_flight_but_keep_the_intervals(tmp_path: Path) -> None:
    times = flown(film(interval=0.2, slow=0.7), tmp_path)
    assert gaps(times)[0] >= 0.69
    assert min(gaps(times)[1:]) > 0.1


def test_a_file_comes_after_its_trigger(tmp_path: Path) -> None:
    delivery, sent = Delivery(tmp_path, delay=0.3, writing=0.1), time.monotonic()
    delivery.send("a.JPG", b"x" * 100)
    assert not (tmp_path / "a.JPG").exists()
    delivery.finish()
    assert time.monotonic() - sent >= 0.3
    assert (tmp_path / "a.JPG").stat().st_size == 100


def test_a_watcher_sees_the_file_grow(tmp_path: Path) -> None:
    delivery, sizes = Delivery(tmp_path, delay=0.0, writing=0.6), {0}
    delivery.send("a.JPG", b"x" * 1000)
    while max(sizes) < 1000:
        sizes.add((tmp_path / "a.JPG").stat().st_size if (tmp_path / "a.JPG").exists() else 0)
        time.sleep(0.01)
    delivery.finish()
    assert len({250, 500, 750} & sizes) >= 2


def test_an_empty_file_is_a_file(tmp_path: Path) -> None:
    write_slowly(tmp_path / "a.JPG", b"", 0.0)
    assert (tmp_path / "a.JPG").read_bytes() == b""


def test_a_picture_that_cannot_be_written_is_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / "DCIM").write_text("a file where the folder should be")
    with pytest.raises(OSError, match="DCIM"):
        flown(film(count=2), tmp_path)
