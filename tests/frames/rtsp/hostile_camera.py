"""A camera that means harm: an RTSP server on loopback that says what a test has it say, and sends what it likes."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

Talk = Callable[[socket.socket, "HostileCamera"], None]

SDP = """v=0
o=- 0 0 IN IP4 127.0.0.1
s=x
c=IN IP4 127.0.0.1
t=0 0
m=video 0 RTP/AVP 96
a=rtpmap:96 H264/90000
a=control:track
"""


@dataclass
class HostileCamera:
    """Answers as `answers` says, by method; `flood`: what is sent on the connection after PLAY, for as long as it is taken."""

    sdp: str | Callable[[], Iterator[bytes]] = SDP
    answers: dict[str, bytes] = field(default_factory=dict)
    flood: Callable[[], Iterator[bytes]] = lambda: iter(())
    talk: Talk | None = None
    sent: int = 0

    def __enter__(self) -> HostileCamera:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._open = list[socket.socket]()
        self.calls = 0
        threading.Thread(target=self._serve, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for one in self._open:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    @property
    def url(self) -> str:
        return f"rtsp://127.0.0.1:{self._socket.getsockname()[1]}/x"

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self._socket.accept()
                self.calls += 1
                self._open.append(connection)
                threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with connection, suppress(OSError, IndexError, ValueError):
            if self.talk is not None:
                self.talk(connection, self)
                return
            while request := self._request(connection):
                method = request.split(" ", 1)[0]
                number = request.lower().split("cseq:")[1].split("\r\n")[0].strip()
                self._reply(connection, method, number)
                if method == "PLAY":
                    threading.Thread(target=self._flood, args=(connection,), daemon=True).start()

    def _request(self, connection: socket.socket) -> str:
        data = b""
        while b"\r\n\r\n" not in data:
            chunk = connection.recv(4096)
            if not chunk:
                return ""
            data += chunk
        return data.decode("latin-1")

    def _reply(self, connection: socket.socket, method: str, number: str) -> None:
        if method in self.answers:
            connection.sendall(self.answers[method].replace(b"%d", number.encode()))
            return
        head = f"RTSP/1.0 200 OK\r\nCSeq: {number}\r\nSession: 1\r\n"
        if method == "DESCRIBE" and isinstance(self.sdp, str):
            kind = f"Content-Type: application/sdp\r\nContent-Length: {len(self.sdp)}"
            connection.sendall(f"{head}{kind}\r\n\r\n{self.sdp}".encode())
        elif method == "DESCRIBE" and not isinstance(self.sdp, str):
            connection.sendall(f"{head}Content-Type: application/sdp\r\nContent-Length: 2000000000\r\n\r\n".encode())
            self._pour(connection, self.sdp())
        elif method == "SETUP":
            connection.sendall(f"{head}Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n\r\n".encode())
        else:
            connection.sendall(f"{head}Public: OPTIONS, DESCRIBE, SETUP, PLAY\r\n\r\n".encode())

    def _flood(self, connection: socket.socket) -> None:
        self._pour(connection, self.flood())

    def _pour(self, connection: socket.socket, chunks: Iterator[bytes]) -> None:
        with suppress(OSError):
            for chunk in chunks:
                connection.sendall(chunk)
                self.sent += len(chunk)


def rtp(payload: bytes, number: int, time: int, kind: int = 96, *, last: bool = True) -> bytes:
    """A packet of the first track, interleaved on the connection (RFC 2326, 10.12)."""
    head = struct.pack(">BBHII", 0x80, kind | 0x80 * last, number & 0xFFFF, time & 0xFFFFFFFF, 7)
    return b"$\0" + struct.pack(">H", len(head) + len(payload)) + head + payload
