"""The program under test, as an operator runs it: a process, a folder, signals. None of its code is imported."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

START_TIMEOUT = 60.0  # seconds until it listens
STALL_TIMEOUT = 120.0  # seconds without progress
STOP_TIMEOUT = 180.0  # seconds to finish the current frame and paint the final poses
EXPORT_TIMEOUT = 300.0
POLL = 0.1

# Windows has no SIGTERM that a process can handle; Ctrl-Break to its own process group is the closest equivalent.
OWN_GROUP: int = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
END: signal.Signals = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGTERM)


class ProgramError(Exception):
    """The program failed; the message is one sentence for the operator."""


@dataclass(slots=True)
class Program:
    """gcs-mosaic, listening on a local UDP port, watching one folder, writing to another."""

    port: int
    watch: Path
    out: Path
    http: str | None
    rtsp: str | None = None  # URL of a live stream, instead of the folder
    anchor: str | None = None  # what lays the map on earth
    aircraft: int = 1  # of several, each has a folder of its own below the watched one
    more_ports: tuple[int, ...] = ()  # of further links
    process: subprocess.Popen[bytes] | None = field(default=None)

    def command(self) -> list[str]:
        page = ["--http", self.http] if self.http else ["--no-http"]
        links = [word for port in (self.port, *self.more_ports) for word in ("--mavlink", f"udp:127.0.0.1:{port}")]
        anchor = ["--anchor", self.anchor] if self.anchor else []
        where = [*self.sources(), "--out", str(self.out), "--new", *anchor]
        return [sys.executable, "-m", "gcs_mosaic", *links, *where, *page]

    def sources(self) -> list[str]:
        """Where frames come from, in words of the command line."""
        if self.rtsp:
            return ["--rtsp", self.rtsp]
        if self.aircraft == 1:
            return ["--watch", str(self.watch)]
        of_each = range(1, self.aircraft + 1)
        return [word for system in of_each for word in ("--watch", f"{system}={self.folder_of(system)}")]

    def folder_of(self, system: int) -> Path:
        """Where the pictures of one of several aircraft go."""
        return self.watch / f"aircraft-{system}"

    def ports_of_each(self, count: int) -> list[int]:
        """The port that each aircraft sends to: the one link, or each its own."""
        ports = [self.port, *self.more_ports]
        return ports if len(ports) == count else [self.port] * count

    def start(self) -> None:
        """Start it and wait until it listens. In its own session, so that Ctrl-C reaches only us and we stop it cleanly."""
        self.process = subprocess.Popen(self.command(), start_new_session=True, creationflags=OWN_GROUP)
        deadline = time.monotonic() + START_TIMEOUT
        while not (self.out / "status.json").exists():
            self.must_run()
            if time.monotonic() > deadline:
                raise ProgramError(
                    f"gcs-mosaic wrote no {self.out / 'status.json'} within {START_TIMEOUT:.0f} s of its start"
                )
            time.sleep(POLL)

    def runs(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def must_run(self) -> None:
        code = None if self.process is None else self.process.poll()
        if code is not None:
            raise ProgramError(f"gcs-mosaic ended by itself with exit code {code}; what it said is above")

    def account(self, kind: str) -> dict[str, int]:
        """The counts of "frames" or "events" in mosaic.json; empty until it exists."""
        data = json_of(self.out / "mosaic.json")
        found = data.get(kind)
        return {str(key): int(value) for key, value in found.items()} if isinstance(found, dict) else {}

    def wait_for(self, count: int, said: Callable[[dict[str, int]], None], meanwhile: Callable[[], None]) -> None:
        """Wait until `count` frames are processed and none is pending; `meanwhile` is called at every poll."""
        last, changed = self.account("frames"), time.monotonic()
        while processed(last) < count:
            self.must_run()
            meanwhile()
            time.sleep(POLL)
            account = self.account("frames")
            if account != last:
                last, changed = account, time.monotonic()
                said(account)
            if time.monotonic() - changed > STALL_TIMEOUT:
                done = f"gcs-mosaic processed {processed(last)} of {count} pictures"
                raise ProgramError(f"{done}, then nothing moved for {STALL_TIMEOUT:.0f} s: {last}")

    def stop(self) -> int:
        """Send SIGTERM, as a service manager does, and return the exit code. Killed if it does not end."""
        if self.process is None:
            return 0
        self.process.send_signal(END)
        try:
            return self.process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise ProgramError(
                f"gcs-mosaic did not end within {STOP_TIMEOUT:.0f} s of SIGTERM and was killed"
            ) from None

    def placements(self, file: Path) -> dict[str, Any]:
        """All placements, from `gcs-mosaic export`."""
        command = [
            sys.executable,
            "-m",
            "gcs_mosaic",
            "export",
            str(self.out),
            "--format",
            "placements",
            "--to",
            str(file),
        ]
        done = subprocess.run(command, timeout=EXPORT_TIMEOUT, check=False)
        if done.returncode:
            raise ProgramError(f"gcs-mosaic export ended with exit code {done.returncode}; what it said is above")
        return json_of(file)


def processed(account: dict[str, int]) -> int:
    return sum(account.values()) - account.get("pending", 0)


def json_of(path: Path) -> dict[str, Any]:
    """The JSON object in a file, empty if missing: files are replaced atomically, so they are whole or absent."""
    try:
        data = json.loads(path.read_text())
    except FileNotFoundError:
        return {}
    return data if isinstance(data, dict) else {}
