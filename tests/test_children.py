"""Ctrl-C, a closed terminal and a service manager are for the program alone; no child dies of them before its turn."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import gcs_mosaic
from gcs_mosaic.frames.decoding.worker import work
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.stream_process import receive
from gcs_mosaic.frames.video.process import describe_videos
from gcs_mosaic.hints.hint_process import seek_hints
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.processes.child import ChildProcess
from gcs_mosaic.stitch.bundle import worker as adjusting
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.page_process import serve_page
from gcs_mosaic.web.page_task import PageTask
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access
from tests.web.small_flight import SmallFlight

PACKAGE = Path(gcs_mosaic.__file__).parent
SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
IN_TIME_S = 60.0
CHILDREN: dict[str, tuple[Callable[..., None], Callable[[Path], tuple[Any, ...]]]] = {
    "adjust": (adjusting._work, lambda _: ()),
    "decode": (work, lambda _: (None,)),
    "stream": (receive, lambda _: ("rtsp://127.0.0.1:9/x", StreamSettings())),
    "video": (describe_videos, lambda folder: ([str(folder / "none.mp4")], 10**6)),
    "page": (
        serve_page,
        lambda folder: (
            PageTask(root=folder, address=HttpAddress("127.0.0.1", 0), access=Access(), settings=WebSettings()),
        ),
    ),
    "hints": (seek_hints, lambda folder: (folder, HintSettings())),
}


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name", CHILDREN)
def test_each_child_outlives_what_is_for_the_program(name: str, tmp_path: Path) -> None:
    """From its first moment on; and it ends by itself when its pipe is closed."""
    if name in ("stream", "video"):
        pytest.importorskip("av")
    SmallFlight(tmp_path).write()
    target, given = CHILDREN[name]
    child = ChildProcess(name, target, *given(tmp_path))
    try:
        assert os.getpgid(child.pid) != os.getpgid(0), "Ctrl-C is not sent to it at all"
        for sign in SIGNALS:
            os.kill(child.pid, sign)
        if name == "adjust":
            child.pipe.send("no task")
        assert child.pipe.poll(IN_TIME_S)
        assert child.pipe.recv_bytes()
        for sign in SIGNALS:
            os.kill(child.pid, sign)
    finally:
        code = child.end(IN_TIME_S)
    assert code == 0


def test_one_room_starts_processes() -> None:
    starts = re.compile(r"\.Process\(\s*target=|subprocess\.Popen\(|create_subprocess_exec\(")
    rooms = [path for path in PACKAGE.rglob("*.py") if path.parts[-2] not in ("cli", "sitl", "config")]
    found = {path.relative_to(PACKAGE).as_posix() for path in rooms if starts.search(path.read_text("utf-8"))}
    assert found == {"processes/child.py"}


def test_whatever_runs_in_a_child_is_tried_here() -> None:
    given = re.compile(r"ChildProcess\(\s*\w+, (\w+)")
    found = {name for path in PACKAGE.rglob("*.py") for name in given.findall(path.read_text("utf-8"))}
    tried = {target.__name__ for target, _ in CHILDREN.values()}
    assert found - {"read_video"} == tried, "read_video runs in the process of describe_videos' kind"
