"""Other people's programs on real links: every shot of theirs is matched, and recordings are read by each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.tlog_reader import read_recording
from tests.peers.cameras import Camera, Station, forwarder, need_mavproxy, need_mavsdk
from tests.ports import free_port
from tests.running import Running, events_of, flying, frames_of

SHOTS = 4


def port_of(flight: Running) -> int:
    return int(flight.vehicle.socket.getpeername()[1])


@contextmanager
def photographed(flight: Running, link: int, pictures: list[bytes]) -> Iterator[list[str]]:
    """A camera whose first link goes to a port and whose second goes to a ground station, which has it take pictures."""
    mavsdk, command = need_mavsdk(), free_port()

    def bring(name: str) -> None:
        flight.bring(name, pictures[int(name[4:8])])

    with closing(Camera(mavsdk, [link, command], bring)) as camera, closing(Station(mavsdk, command)) as station:
        for _ in range(SHOTS):
            station.take_photo()
        yield camera.taken
        flight.wait_for_frames(placed=SHOTS)
        flight.wait_for(lambda status: status["events"]["matched"] == SHOTS, "all shots are matched")
        assert flight.end() == 0


def assert_every_shot_matched(flight: Running, taken: list[str]) -> None:
    assert events_of(flight.out) == ["matched"] * SHOTS
    assert list(frames_of(flight.out)) == taken
    assert all(frame.had_event and frame.state == "placed" for frame in frames_of(flight.out).values())


@pytest.mark.long
def test_every_shot_of_a_camera_of_mavsdk_is_matched(tmp_path: Path, pictures: list[bytes]) -> None:
    need_mavsdk()
    with flying(tmp_path) as flight, photographed(flight, port_of(flight), pictures) as taken:
        assert len(taken) == SHOTS
    assert_every_shot_matched(flight, taken)


@pytest.mark.long
def test_through_mavproxy_and_the_recordings_of_both_are_alike(tmp_path: Path, pictures: list[bytes]) -> None:
    need_mavsdk()
    need_mavproxy()
    port = free_port()
    (tmp_path / "mavproxy").mkdir()
    with flying(tmp_path, "--record") as flight:
        with (
            forwarder(port, port_of(flight), tmp_path / "mavproxy") as theirs,
            photographed(flight, port, pictures) as taken,
        ):
            assert len(taken) == SHOTS
        assert_every_shot_matched(flight, taken)
    ours = flight.out / "flight.tlog"
    names = [event.file_hint for event in read_recording(theirs, LinkSettings()).events]
    assert names == [f"100TEST/{name}" for name in taken]
    assert captured(ours) == captured(theirs) == [f"/DCIM/100TEST/{name}" for name in taken]


def captured(recording: Path) -> list[str]:
    """What pymavlink's own reader finds in a recording."""
    log = mavutil.mavlink_connection(str(recording), dialect="ardupilotmega")
    with closing(log):
        return [message.file_url for message in iter(lambda: log.recv_match(type="CAMERA_IMAGE_CAPTURED"), None)]
