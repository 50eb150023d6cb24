"""Other people's programs on the link: MAVSDK's camera and ground station, MAVProxy as a forwarder."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests import fresh

LONGEST_WAIT_S = 30.0
MAVPROXY = fresh.ROOT / ".mavproxy" / "bin" / "mavproxy.py"
PLACE = (47.0, 8.0, 500.0, 50.0)  # degrees and metres


def need_mavsdk() -> ModuleType:
    mavsdk: ModuleType = pytest.importorskip("mavsdk", reason="MAVSDK is not installed: pip install mavsdk")
    return mavsdk


def need_mavproxy() -> Path:
    """The program; skips the test without it, because it is to be had in an environment of its own only."""
    if not MAVPROXY.exists():
        pytest.skip("MAVProxy is not installed: .ci/run does it, into .mavproxy")
    return MAVPROXY


class Camera:
    """MAVSDK's CameraServer, which answers each take_photo with a picture; `take(name)` brings the picture's file."""

    def __init__(self, mavsdk: ModuleType, links: list[int], take: Callable[[str], None]) -> None:
        from mavsdk.plugins.camera_server import camera_server as plugin

        self.taken: list[str] = []
        self._plugin, self._take = plugin, take
        self._sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.CAMERA))
        for port in links:
            self._sdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        self._server = plugin.CameraServer(self._sdk.server_component_by_type(mavsdk.ComponentType.CAMERA))
        self._server.set_information(information(plugin))
        self._server.subscribe_take_photo(self._answer)

    def close(self) -> None:
        self._server.destroy()
        self._sdk.destroy()

    def _answer(self, *_: object) -> None:
        self.taken.append(f"IMG_{len(self.taken):04d}.JPG")
        told = self._plugin.CaptureInfo(
            self._plugin.Position(*PLACE),
            self._plugin.Quaternion(1.0, 0.0, 0.0, 0.0),
            int(time.time() * 1e6),
            True,
            len(self.taken),
            f"/DCIM/100TEST/{self.taken[-1]}",
        )
        self._server.respond_take_photo(self._plugin.CameraFeedback.OK, told)
        self._take(self.taken[-1])


def information(plugin: Any) -> Any:
    lens = {"focal_length_mm": 4.0, "horizontal_sensor_size_mm": 4.0, "vertical_sensor_size_mm": 3.0, "lens_id": 0}
    size = {"horizontal_resolution_px": 640, "vertical_resolution_px": 480}
    name = {"vendor_name": "test", "model_name": "camera", "firmware_version": "1.0.0"}
    rest = {"definition_file_version": 0, "definition_file_uri": ""}
    modes = {"image_in_video_mode_supported": False, "video_in_image_mode_supported": False}
    return plugin.Information(**name, **lens, **size, **rest, **modes)


class Station:
    """MAVSDK as a ground station that has found the camera."""

    def __init__(self, mavsdk: ModuleType, port: int) -> None:
        from mavsdk.plugins.camera.camera import Camera as CameraPlugin

        kind = mavsdk.ComponentType.GROUND_STATION
        self._sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        self._sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        wait(self._sdk.get_systems, "the ground station sees the camera's system")
        self._camera = CameraPlugin(self._sdk.get_systems()[0])
        wait(self._cameras, "the ground station knows the camera")

    def take_photo(self) -> None:
        self._camera.take_photo(self._cameras()[0].component_id)

    def close(self) -> None:
        self._camera.destroy()
        self._sdk.destroy()

    def _cameras(self) -> list[Any]:
        known = self._camera.camera_list()
        return list(known.cameras) if known else []


@contextmanager
def forwarder(heard: int, told: int, home: Path) -> Iterator[Path]:
    """MAVProxy, which listens on one port, sends on to another and writes a recording, whose path is given."""
    words = [f"--master=udpin:127.0.0.1:{heard}", f"--out=udpout:127.0.0.1:{told}", "--daemon", "--streamrate=-1"]
    # Without flushing, what is recorded reaches the file only when MAVProxy ends in good order, which it may not.
    place = ["--default-modules=", f"--state-basedir={home}", "--aircraft=test", "--cmd=set flushlogs 1"]
    command = [str(need_mavproxy().with_name("python")), str(need_mavproxy()), *words, *place]
    with ExitStack() as stack:
        said = stack.enter_context((home / "mavproxy.txt").open("wb"))
        environment = fresh.environment(HOME=str(home), PYTHONUNBUFFERED="1")
        streams: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": said, "stderr": subprocess.STDOUT}
        process = subprocess.Popen(command, cwd=home, env=environment, start_new_session=True, **streams)
        stack.callback(end, process)
        wait(lambda: "Waiting for heartbeat" in (home / "mavproxy.txt").read_text(), "MAVProxy listens")
        yield next(home.rglob("flight.tlog"))


def end(process: subprocess.Popen[bytes]) -> None:
    """MAVProxy writes the rest of its recording when it is asked to end."""
    os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def wait(true: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + LONGEST_WAIT_S
    while not true():
        assert time.monotonic() < deadline, f"still not so: {what}"
        time.sleep(0.05)
