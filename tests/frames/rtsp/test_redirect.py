"""A camera may redirect to itself, and to hosts that are allowed; small real servers answer."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from gcs_mosaic.frames.rtsp.address import parse_stream
from gcs_mosaic.frames.rtsp.redirect import MOST_REDIRECTS, final_address

av = pytest.importorskip("av")

from gcs_mosaic.frames.rtsp.connection import LOGIN_WANTED, Connection, NotConnected  # noqa: E402 - needs PyAV
from gcs_mosaic.frames.rtsp.settings import StreamSettings  # noqa: E402

Answer = Callable[[bytes], bytes]
OK = b"RTSP/1.0 200 OK\r\nCSeq: %d\r\nPublic: DESCRIBE\r\n\r\n"
NOT_FOUND = b"RTSP/1.0 404 Not Found\r\nCSeq: %d\r\n\r\n"


class Server:
    """Answers each request by `answer`, until it is closed."""

    def __init__(self, host: str, answer: Answer) -> None:
        self.asked: list[bytes] = []
        self._answer = answer
        self._socket = socket.create_server((host, 0))
        self.port = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with connection:
                connection.settimeout(5.0)
                self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        try:
            while request := connection.recv(4096):
                self.asked.append(request)
                number = int(request.lower().split(b"cseq:")[1].split(b"\r\n")[0])
                connection.sendall(self._answer(request).replace(b"%d", b"%d" % number))
        except OSError:
            return

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(5.0)


def redirects_to(url: str) -> Answer:
    moved = f"RTSP/1.0 302 Moved\r\nCSeq: %d\r\nLocation: {url}\r\n\r\n".encode()
    return lambda request: moved if request.startswith(b"DESCRIBE") else OK


@pytest.fixture
def serve() -> Iterator[Callable[[str, Answer], Server]]:
    with ExitStack() as stack:

        def start(host: str, answer: Answer) -> Server:
            server = Server(host, answer)
            stack.callback(server.close)
            return server

        yield start


Serve = Callable[[str, Answer], Server]


def test_a_redirect_to_another_host_is_refused_and_that_host_hears_nothing(serve: Serve) -> None:
    other = serve("127.0.0.2", lambda request: NOT_FOUND)
    camera = serve("127.0.0.1", redirects_to(f"rtsp://127.0.0.2:{other.port}/inside"))
    address = parse_stream(f"rtsp://me:secret@127.0.0.1:{camera.port}/main")
    found = Connection.open(address, StreamSettings(open_timeout_s=2.0), [])
    assert isinstance(found, NotConnected)
    assert found.reason == "it redirects to the host 127.0.0.2, which is not in stream: allowed_hosts"
    assert other.asked == []
    assert b"secret" not in b"".join(camera.asked)


def test_a_camera_that_wants_a_login_is_told_as_such(serve: Serve) -> None:
    wants = b'RTSP/1.0 401 Unauthorized\r\nCSeq: %d\r\nWWW-Authenticate: Basic realm="camera"\r\n\r\n'
    camera = serve("127.0.0.1", lambda request: wants if request.startswith(b"DESCRIBE") else OK)
    for login in ("", "me:secret@"):
        address = parse_stream(f"rtsp://{login}127.0.0.1:{camera.port}/main")
        assert Connection.open(address, StreamSettings(open_timeout_s=2.0), []) == NotConnected(LOGIN_WANTED)


def test_a_redirect_to_a_host_that_is_allowed_is_followed(serve: Serve) -> None:
    other = serve("127.0.0.2", lambda request: NOT_FOUND)
    camera = serve("127.0.0.1", redirects_to(f"rtsp://127.0.0.2:{other.port}/inside"))
    address = parse_stream(f"rtsp://127.0.0.1:{camera.port}/main")
    found = final_address(address, ["127.0.0.0/8"], 2.0)
    assert not isinstance(found, str)
    assert found.url == f"rtsp://127.0.0.2:{other.port}/inside"


def test_a_redirect_to_the_camera_itself_keeps_the_login(serve: Serve) -> None:
    real = serve("127.0.0.1", lambda request: NOT_FOUND)
    camera = serve("127.0.0.1", redirects_to(f"rtsp://127.0.0.1:{real.port}/sub"))
    found = final_address(parse_stream(f"rtsp://me:secret@127.0.0.1:{camera.port}/main"), [], 2.0)
    assert not isinstance(found, str)
    assert found.url == f"rtsp://me:secret@127.0.0.1:{real.port}/sub"


def test_a_camera_that_answers_ffmpeg_otherwise_is_left(serve: Serve) -> None:
    """Our own question gets no redirect, FFmpeg's does: it is known by the OPTIONS before it."""
    other = serve("127.0.0.2", lambda request: NOT_FOUND)
    moved = redirects_to(f"rtsp://127.0.0.2:{other.port}/inside")
    camera = serve("127.0.0.1", lambda request: moved(request) if b"Lavf" in request else NOT_FOUND)
    address = parse_stream(f"rtsp://127.0.0.1:{camera.port}/main")
    with av.logging.Capture() as log:
        found = Connection.open(address, StreamSettings(open_timeout_s=2.0), log)
    assert isinstance(found, NotConnected)
    assert found.reason == "it redirects to the host 127.0.0.2, which is not in stream: allowed_hosts"


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (redirects_to("file:///etc/passwd"), "it redirects to an address that is not understood"),
        (redirects_to("rtsp://[::1/x"), "it redirects to an address that is not understood"),
        (lambda request: b"x" * 100_000, None),
        (lambda request: b"RTSP/1.0 302 Moved\r\n\r\n", None),
        (lambda request: NOT_FOUND, None),
    ],
)
def test_odd_answers(serve: Serve, answer: Answer, reason: str | None) -> None:
    camera = serve("127.0.0.1", answer)
    address = parse_stream(f"rtsp://127.0.0.1:{camera.port}/main")
    assert final_address(address, [], 1.0) == (reason or address)


def test_a_circle_of_redirects_ends(serve: Serve) -> None:
    circle = serve("127.0.0.1", lambda request: redirects_to(f"rtsp://127.0.0.1:{circle.port}/main")(request))
    address = parse_stream(f"rtsp://127.0.0.1:{circle.port}/main")
    assert final_address(address, [], 5.0) == f"it redirects more than {MOST_REDIRECTS} times"


def test_a_camera_that_does_not_answer_redirects_nowhere() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = parse_stream(f"rtsp://127.0.0.1:{silent.getsockname()[1]}/main")
        assert final_address(address, [], 0.3) == address
