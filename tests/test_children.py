"""Ctrl-C, a closed terminal and a service manager reach all processes of the program at once: they are for the program alone."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gcs_mosaic.children as children

PACKAGE = Path(children.__file__).parent
SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
# Who starts processes, and what runs in them: begin there with `outlive_signals`.
CHILDREN = {
    "processes/child.py": "processes/main.py",
    "web/hint_keeper.py": "hints/hint_process.py",
}
LONG_START = """
import sys, time
time.sleep(0.5)  # imports take as long
from gcs_mosaic.children import outlive_signals
outlive_signals()
print("there", flush=True)
sys.stdin.read()
print("ended", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("sign", SIGNALS)
def test_a_child_outlives_them_from_its_first_moment(sign: signal.Signals) -> None:
    """The process that adjusts the map died of SIGHUP; one that was still loading died of all of them."""
    with children.starting():
        child = subprocess.Popen(
            [sys.executable, "-c", LONG_START], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    with child:
        try:
            time.sleep(0.1)
            child.send_signal(sign)
            assert child.stdout is not None
            assert child.stdout.readline() == "there\n"
            child.send_signal(sign)
            assert child.communicate(timeout=20)[0] == "ended\n"
        finally:
            child.kill()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []).isdisjoint(SIGNALS), "the program hears them as before"


def test_each_process_of_the_program_begins_so() -> None:
    starts = re.compile(r"\.Process\(\s*target=|subprocess\.Popen\(|create_subprocess_exec\(")
    rooms = [path for path in PACKAGE.rglob("*.py") if path.parts[-2] not in ("cli", "sitl", "config")]
    found = {path.relative_to(PACKAGE).as_posix() for path in rooms if starts.search(path.read_text("utf-8"))}
    assert found == set(CHILDREN)
    for begins in CHILDREN.values():
        assert re.search(r"(?:outlive_signals|begin_as_child)\(\)", (PACKAGE / begins).read_text("utf-8"))
