"""What systemd is told, on a real socket; by the real daemon too."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from gcs_mosaic.app.status.service_manager import ServiceManager
from tests.running import flying

if sys.platform == "win32":
    pytest.skip("there is no systemd", allow_module_level=True)


PATIENCE_S = 40.0  # for a message, on a busy machine


class Systemd:
    """The socket of a service manager; `told` is what has come since."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address.replace("@", "\0", 1))
        self._socket.settimeout(PATIENCE_S)

    def environment(self, watchdog_s: float = 0.0) -> dict[str, str]:
        watchdog = {"WATCHDOG_USEC": str(round(watchdog_s * 1e6))} if watchdog_s else {}
        return {"NOTIFY_SOCKET": self.address, **watchdog}

    def next(self) -> list[str]:
        """The lines of the next message."""
        return self._socket.recv(4096).decode().split("\n")

    def until(self, line: str) -> list[str]:
        """All lines up to the message that has one that begins so."""
        lines = list[str]()
        while not any(told.startswith(line) for told in lines):
            lines += self.next()
        return lines

    def until_silent(self, seconds: float) -> None:
        """Wait until nothing has come for so long."""
        self._socket.settimeout(seconds)
        with suppress(TimeoutError):
            while True:
                self._socket.recv(4096)
        self._socket.settimeout(PATIENCE_S)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(params=["a file", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Systemd]:
    if request.param == "abstract" and sys.platform != "linux":
        pytest.skip("only Linux has such names")
    at = f"@gcs-mosaic-test-{os.getpid()}" if request.param == "abstract" else str(tmp_path / "notify")
    systemd = Systemd(at)
    yield systemd
    systemd.close()


def test_ready_status_and_ending_are_told(systemd: Systemd) -> None:
    manager = ServiceManager(systemd.environment(watchdog_s=8.0))
    manager.ready()
    manager.status("flying: 3 frames\nplaced")
    manager.status("too soon after it")
    manager.alive()
    manager.alive()  # too soon, too
    manager.ending()
    told = [systemd.next() for _ in range(5)]
    assert told[:3] == [["READY=1"], ["STATUS=flying: 3 frames placed"], ["WATCHDOG=1"]]
    assert told[3] == ["STOPPING=1", "WATCHDOG_USEC=1200000000"]
    assert told[4] == ["WATCHDOG=1", "EXTEND_TIMEOUT_USEC=60000000"]
    manager.close()


def test_a_watchdog_of_another_process_is_not_ours(systemd: Systemd) -> None:
    manager = ServiceManager(systemd.environment(watchdog_s=8.0) | {"WATCHDOG_PID": str(os.getpid() + 1)})
    manager.ending()
    assert systemd.next() == ["STOPPING=1"]
    manager.close()


def test_nothing_is_told_where_nobody_asks() -> None:
    manager = ServiceManager({})
    manager.ready()
    manager.alive()
    manager.status("flying")
    manager.ending()
    manager.close()


def test_a_service_manager_that_is_gone_ends_no_flight(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    manager.ready()
    manager.ending()
    assert [record.message for record in caplog.records] == ["the service manager cannot be told"]
    manager.close()


@pytest.mark.long
def test_the_daemon_is_ready_turns_and_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    systemd = Systemd(str(tmp_path / "notify"))
    for name, value in systemd.environment(watchdog_s=0.4).items():
        monkeypatch.setenv(name, value)
    with flying(tmp_path / "home") as flight:
        assert "STATUS" not in "".join(systemd.until("READY=1"))  # the first thing that is said
        assert "STATUS=listening: 0 frames placed, none waits" in systemd.until("STATUS=")
        assert systemd.until("WATCHDOG=1")
        flight.process.send_signal(signal.SIGSTOP)  # a loop that does not turn
        systemd.until_silent(1.0)
        flight.process.send_signal(signal.SIGCONT)
        assert systemd.until("WATCHDOG=1")
        assert flight.end() == 0
        assert "EXTEND_TIMEOUT_USEC=60000000" in systemd.until("EXTEND_TIMEOUT_USEC")
    systemd.close()
