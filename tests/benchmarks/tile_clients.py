"""Clients that ask for tiles at a fixed rate, as cheaply as can be: they are not what is measured.

python -m tests.benchmarks.tile_clients PORT FLIGHT, until its input ends; prints how many were asked for and came, as JSON.
"""

from __future__ import annotations

import json
import random
import select
import socket
import sys
import time
from pathlib import Path

CLIENTS, PER_SECOND = 20, 200.0
LOOK_EACH_S = 2.0  # for new tiles
ROOM = 1 << 20


class Client:
    """A connection that stays, with one request under way."""

    def __init__(self, port: int, room: memoryview) -> None:
        self._port, self._room = port, room
        self._socket: socket.socket | None = None

    def ask(self, path: str) -> None:
        """Raises OSError."""
        if self._socket is None:
            self._socket = socket.create_connection(("127.0.0.1", self._port), timeout=5)
        self._socket.sendall(f"GET /{path} HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\n\r\n".encode())

    def came(self) -> bool:
        """Whether the tile that was asked for came; waits for it. Raises OSError."""
        if self._socket is None:
            return False
        got, end = 0, -1
        while end < 0:
            got += self._more(got)
            end = bytes(self._room[:got]).find(b"\r\n\r\n")
        head = bytes(self._room[:end]).lower()
        size = int(head.partition(b"content-length:")[2].split(b"\r\n")[0] or 0)
        while got < end + 4 + size:
            got += self._more(got)
        return head.startswith(b"http/1.1 200")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _more(self, got: int) -> int:
        assert self._socket is not None
        count = self._socket.recv_into(self._room[got:])
        if not count:
            raise ConnectionError
        return count


def tiles_in(flight: Path) -> list[str]:
    found = [str(path.relative_to(flight)).rsplit(".", 1)[0] for path in (flight / "tiles").rglob("*.*")]
    return found or ["tiles/0/16/1/1"]


def main() -> None:
    port, flight = int(sys.argv[1]), Path(sys.argv[2])
    room, chance = memoryview(bytearray(ROOM)), random.Random(1)
    clients = [Client(port, room) for _ in range(CLIENTS)]
    asked = came = 0
    known, looked, began = tiles_in(flight), time.monotonic(), time.monotonic()
    while not select.select([sys.stdin], [], [], max(0.0, began + asked / PER_SECOND - time.monotonic()))[0]:
        if time.monotonic() - looked > LOOK_EACH_S:
            known, looked = tiles_in(flight), time.monotonic()
        client = clients[asked % CLIENTS]
        asked += 1
        try:
            came += client.came()
            client.ask(chance.choice(known))
        except OSError:
            client.close()
    print(json.dumps({"asked a second": round(asked / (time.monotonic() - began)), "came": came}), flush=True)


if __name__ == "__main__":
    main()
