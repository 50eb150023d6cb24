"""Without what only POSIX systems have, everything imports, and what is missing is said in one sentence or done otherwise."""

from __future__ import annotations

import ctypes
import os
import pkgutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import gcs_mosaic
import sitl
from gcs_mosaic.cli import main as cli
from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.datagrams import DatagramReader
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.render.tile_cache import Store
from sitl.stream.camera import StreamingCamera

ROOT = Path(__file__).parent.parent
MODULES = ("fcntl", "termios", "tty", "resource", "pwd", "grp", "pty")
ATTRIBUTES = {
    "os": (
        *("nice", "pread", "pwrite", "preadv", "pwritev", "sync", "fork", "forkpty", "getloadavg", "sched_getaffinity"),
        *(
            "getuid",
            "geteuid",
            "getgid",
            "getpgid",
            "setsid",
            "killpg",
            "uname",
            "sysconf",
            "statvfs",
            "mkfifo",
            "chown",
        ),
        *("posix_fadvise", "posix_fallocate", "O_DIRECTORY", "O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_DIRECT"),
    ),
    "signal": (
        "SIGHUP",
        "SIGUSR1",
        "SIGUSR2",
        "SIGALRM",
        "SIGCHLD",
        "SIGSTOP",
        "SIGCONT",
        "SIGKILL",
        "SIGPIPE",
        "alarm",
    ),
    "socket": ("AF_UNIX", "MSG_DONTWAIT", "SO_REUSEPORT", "CMSG_LEN", "CMSG_SPACE"),
    "select": ("poll", "epoll"),
}
# Other people's packages know Windows by its name, not by what it lacks: they are loaded before anything is taken away.
CRIPPLED = """
import ctypes, importlib, os, select, signal, socket, sys
for name in {others}:
    importlib.import_module(name)

class Refusing:
    def find_spec(self, name, path=None, target=None):
        if name in {modules}:
            raise ImportError(f"no module named {{name!r}} on this system")

for name in {modules}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Refusing())
for owner, names in {attributes}.items():
    for name in names:
        if hasattr(sys.modules[owner], name):
            delattr(sys.modules[owner], name)

def without_none(kind):
    class Library(kind):
        def __init__(self, name, *more, **named):
            if name is None:
                raise TypeError("argument of type 'NoneType' is not iterable")
            super().__init__(name, *more, **named)
    return Library

ctypes.CDLL, ctypes.PyDLL = without_none(ctypes.CDLL), without_none(ctypes.PyDLL)
"""
OTHERS = (
    *(
        "aiohttp.web",
        "asyncio",
        "av",
        "cv2",
        "distributed",
        "multiprocessing.connection",
        "numpy",
        "pymavlink.dialects.v20.ardupilotmega",
    ),
    *(
        "obstore",
        "rich.console",
        "rich.live",
        "scipy.linalg",
        "scipy.ndimage",
        "scipy.sparse.linalg",
        "sqlite3",
        "tifffile",
        "yaml",
    ),
)


def modules_of(package: str, folders: list[str]) -> Iterator[str]:
    for found in pkgutil.walk_packages(folders, f"{package}."):
        if found.name != "sitl.stream.server":  # a program of its own, for a Python with GStreamer
            yield found.name


def run(program: str) -> subprocess.CompletedProcess[str]:
    """In a Python without what only POSIX systems have."""
    crippled = CRIPPLED.format(others=OTHERS, modules=MODULES, attributes=ATTRIBUTES)
    return subprocess.run(
        [sys.executable, "-c", f"{crippled}\n{program}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.long
def test_every_module_imports_without_what_only_posix_has() -> None:
    names = [*modules_of("gcs_mosaic", list(gcs_mosaic.__path__)), *modules_of("sitl", list(sitl.__path__))]
    assert {"gcs_mosaic.mavlink.serial_port", "gcs_mosaic.store.lock", "sitl.stream.camera"} <= set(names)
    program = f"""
import traceback
for name in {names}:
    try:
        importlib.import_module(name)
    except Exception:
        print(name, traceback.format_exc())
"""
    done = run(program)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.long
def test_the_test_takes_away_what_it_says() -> None:
    done = run("import fcntl")
    assert "no module named 'fcntl'" in done.stderr
    assert run("print(hasattr(os, 'fork'), hasattr(signal, 'SIGHUP'))").stdout == "False False\n"
    assert "TypeError" in run("ctypes.CDLL(None)").stderr


def without(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """These modules cannot be imported."""
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)


def test_a_serial_link_is_refused_at_once_in_one_sentence_where_there_is_no_termios(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without(monkeypatch, "fcntl", "termios", "tty")
    with pytest.raises(UsageError) as error:
        triggers(parse_address("COM3,57600"), threading.Event())
    said = str(error.value)
    assert "'COM3'" in said
    assert "termios" in said
    assert "--mavlink udp:14445" in said
    assert said.endswith(".")


def no_library(name: str | None, **options: bool) -> ctypes.PyDLL:
    raise TypeError("as on Windows")


@pytest.mark.parametrize("lacking", ["library", "flag"])
def test_datagrams_are_read_by_the_socket_where_the_c_library_is_not_to_be_had(
    monkeypatch: pytest.MonkeyPatch, lacking: str
) -> None:
    if lacking == "library":
        monkeypatch.setattr(ctypes, "PyDLL", no_library)
    else:
        monkeypatch.delattr(socket, "MSG_DONTWAIT")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        bound.bind(("127.0.0.1", 0))
        sender.connect(bound.getsockname())
        sender.send(b"one")
        found = DatagramReader(bound).read(5.0)
        assert [(one.data, one.sender) for one in found] == [(b"one", sender.getsockname())]


def test_signals_that_a_system_does_not_have_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    monkeypatch.setattr(signal, "signal", lambda number, ask: told.append(number))
    monkeypatch.delattr(signal, "SIGHUP")
    cli._end_on_signals(threading.Event(), threading.Event())
    assert told == [signal.SIGINT, signal.SIGTERM]


def test_ctrl_break_ends_a_flight_where_there_is_such_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    monkeypatch.setattr(signal, "signal", lambda number, ask: told.append(number))
    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR2, raising=False)
    cli._end_on_signals(threading.Event(), threading.Event())
    assert signal.SIGUSR2 in told


def test_a_camera_that_cannot_freeze_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(signal, "SIGSTOP")
    with pytest.raises(ValueError, match="SIGSTOP"):
        StreamingCamera(port=1).freeze()


def test_tiles_come_back_from_the_scratch_file_without_pread_and_pwritev(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "pread")
    monkeypatch.delattr(os, "pwritev")
    values = [np.full(size, size, np.int64) for size in (100, 900, 400, 900, 100, 700)]
    with closing(Store(2000, tmp_path)) as store:
        for key, value in enumerate(values):
            store.put(key, value)
        assert store._file.end
        for key in (0, 5, 1, 4, 2, 3):
            assert np.array_equal(store.get(key), values[key])
        assert store.problem is None
