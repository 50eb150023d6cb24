"""A streaming camera: starts the RTSP server, feeds it pictures, kills and restarts it."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SERVER = Path(__file__).with_name("server.py")
NEEDED = (
    "gir1.2-gst-rtsp-server-1.0 gir1.2-gst-plugins-base-1.0 gstreamer1.0-plugins-good gstreamer1.0-plugins-bad "
    "gstreamer1.0-plugins-ugly python3-gi"
)
_PROBE = (
    "import gi; gi.require_version('Gst', '1.0'); gi.require_version('GstRtspServer', '1.0');"
    "from gi.repository import Gst, GstRtspServer; Gst.init(None);"
    "assert all(map(Gst.ElementFactory.find, ['x264enc', 'x265enc', 'rtph264pay', 'rtph265pay', 'appsrc']))"
)


@cache
def python_with_gstreamer() -> str | None:
    """A Python interpreter with GStreamer's bindings: preferably the system's, which has PyGObject; None if there is none."""
    for python in filter(None, map(shutil.which, ("/usr/bin/python3", "python3"))):
        if not subprocess.run([python, "-c", _PROBE], capture_output=True, check=False).returncode:
            return python
    return None


@dataclass(slots=True, kw_only=True)
class StreamingCamera:
    """A camera at rtsp://127.0.0.1:PORT/camera. Call `start` before `show`; restartable after `kill`."""

    size: tuple[int, int] = (640, 480)  # width, height
    rate: int = 10  # pictures a second, as promised by the caller of `show`
    codec: str = "h264"  # or h265
    key_every: int = 10  # pictures per key frame
    bitrate: int = 8000  # kbit/s
    loss: float = 0.0  # share of lost packets
    user: str = ""  # NAME:PASSWORD required of clients
    port: int = field(default_factory=lambda: free_tcp_port())
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"rtsp://{self.user + '@' if self.user else ''}127.0.0.1:{self.port}/camera"

    def start(self) -> None:
        """Start serving. Raises ValueError if that fails."""
        python = python_with_gstreamer()
        if python is None:
            raise ValueError(f"a streaming camera needs GStreamer: apt-get install {NEEDED}")
        options = {
            **{"port": self.port, "width": self.size[0], "height": self.size[1], "rate": self.rate},
            **{"codec": self.codec, "key-every": self.key_every, "bitrate": self.bitrate},
            **{"loss": self.loss, "user": self.user},
        }
        words = [f"--{name}={value}" for name, value in options.items()]
        self.process = subprocess.Popen([python, str(SERVER), *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        if not self.process.stdout.readline().startswith(b"serving"):
            raise ValueError("GStreamer's RTSP server did not start, what it said is above")

    def show(self, picture: NDArray[np.uint8]) -> float | None:
        """Stream the next picture, (height, width, 3) BGR; returns its capture time (monotonic), None if the server is down."""
        process = self.process
        if process is None or process.stdin is None or process.stdout is None:
            return None
        with suppress(BrokenPipeError, ValueError):  # it is being killed
            process.stdin.write(picture.tobytes())
            process.stdin.flush()
            return float(process.stdout.readline())
        return None

    def freeze(self) -> None:
        """Suspend the server, as if the network went silent."""
        self._send("SIGSTOP")

    def thaw(self) -> None:
        self._send("SIGCONT")

    def kill(self) -> None:
        """Kill the server, as in a power failure."""
        if self.process is not None:
            process, self.process = self.process, None
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    assert pipe is not None
                    pipe.close()

    def _send(self, name: str) -> None:
        number = getattr(signal, name, None)
        if number is None:
            raise ValueError(f"a camera that freezes needs {name}, which this system does not have: use Linux or macOS")
        if self.process is not None:
            self.process.send_signal(number)


def free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
