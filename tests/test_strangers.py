"""A flight folder from somebody else reaches nowhere outside of itself, and opening it is bounded in time and memory.

Found by attack: `check --repair` deleted pictures of a folder to which `tiles` led and called the flight whole, `reprocess`
emptied one, the page served whatever `placements.json` was a link to; a ledger with an endless view hung `check` and outlived
SIGTERM; a rollback journal had SQLite delete a file of somebody else.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.notes.storage.book import NotesBook
from tests.ended_flights import ended_flight
from tests.ports import free_port
from tests.strangers import LEDGERS, LINKS, SECRET, STRANGE_FILES, Trick, an_outside, seen
from tests.web.answers import faults_at

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="links, devices and limits of Linux"),
]
MOST_S = 60.0  # for one command; on a busy machine one that does nothing takes five
MOST_BYTES = 6 << 30  # of address space, of which libraries reserve two
ALL = LINKS | STRANGE_FILES | LEDGERS
COMMANDS = {
    "check": "check {flight}",
    "check tiles": "check {flight} --tiles",
    "repair": "check {flight} --repair",
    "status": "status {flight}",
    "vehicle": "vehicle {flight}",
    "anchor": "anchor {flight}",
    "export": "export {flight} --format png",
    "export bands": "export {flight} --format tiff",
    "export places": "export {flight} --format placements",
    "export finds": "export {flight} --format finds-csv",
    "export tiles": "export {flight} --format xyz",
    "merge": "merge {flight} {other} --out {out}",
    "resume": "--resume --out {flight} --mavlink udp:127.0.0.1:{port} --no-http --watch {watch}",
}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """A flight of six frames that has ended, with notes."""
    out = ended_flight(tmp_path_factory.mktemp("flown") / "flight", world_cache)
    with closing(NotesBook(out)) as book, book.change():
        pass
    return out


@pytest.fixture
def flight(tmp_path: Path, flown: Path) -> Path:
    return shutil.copytree(flown, tmp_path / "flight")


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    return an_outside(tmp_path / "outside")


def run(words: str, cwd: Path) -> tuple[int, str]:
    """The exit code of a command within the limits, and what it has said. One that flies is ended."""
    command = [sys.executable, "-m", "gcs_mosaic", *words.split()]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        command,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES)),
    ) as process:
        try:
            said = process.communicate(timeout=MOST_S if "--resume" not in words else 8)[0]
        except subprocess.TimeoutExpired:
            if "--resume" not in words:
                process.kill()
                raise
            process.send_signal(signal.SIGTERM)
            try:
                said = process.communicate(timeout=MOST_S)[0]
            except subprocess.TimeoutExpired:
                process.kill()
                raise
    return process.returncode, said


@pytest.mark.thorough
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("trick", ALL)
def test_no_command_is_led_outside(
    trick: str, command: str, flight: Path, flown: Path, outside: Path, tmp_path: Path
) -> None:
    suffer(ALL[trick], command, flight, flown, outside, tmp_path)


def suffer(trick: Trick, command: str, flight: Path, flown: Path, outside: Path, tmp_path: Path) -> None:
    """A command on a folder with a trick: it ends within the limits, without a traceback, and nothing outside has changed."""
    trick(flight, outside)
    before, whole = seen(outside), seen(flown)
    (tmp_path / "watch").mkdir()
    words = COMMANDS[command].format(
        flight=flight, other=flown, out=tmp_path / "out", port=free_port(), watch=tmp_path / "watch"
    )
    code, said = run(words, tmp_path)
    assert "Traceback" not in said, said
    assert code in (0, 1, 2, 3), said
    assert SECRET not in said
    assert seen(outside) == before
    assert seen(flown).keys() - {".gcs-mosaic.lock"} == whole.keys() - {".gcs-mosaic.lock"}
    assert not any(path.is_file() and SECRET.encode() in path.read_bytes() for path in (tmp_path / "out").rglob("*"))


ASKED = (
    *(
        "",
        "mosaic.json",
        "placements.json",
        "placements.jsonl?after=0",
        "status.json",
        "tiles/0/16/1/1.jpg",
        "tiles/0/16/32768/32768",
    ),
    *("api/v1/islands/0/sightings?x=1&y=1", "api/v1/frames/1/original", "api/v1/frames/1/picture?reduction=2"),
    *("api/v1/frames/1/pieces/0/0.jpg", "api/v1/finds", "api/v1/anchors", "api/v1/gaps?island=0"),
)
SERVED = {
    **{
        name: trick
        for name, trick in (LINKS | STRANGE_FILES).items()
        if "huge ledger" not in name and "deep" not in name
    },
    **LEDGERS,
}


@pytest.mark.thorough
@pytest.mark.parametrize("trick", SERVED)
def test_what_is_served_lies_in_the_folder(trick: str, flight: Path, outside: Path, tmp_path: Path) -> None:
    serve_it(SERVED[trick], flight, outside, tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "trick", ["an endless view of frames", "paths elsewhere", "a linked document", "devices", "a journal that deletes"]
)
def test_the_page_of_a_strangers_folder_answers_and_ends(
    trick: str, flight: Path, outside: Path, tmp_path: Path
) -> None:
    serve_it(SERVED[trick], flight, outside, tmp_path)


def serve_it(trick: Trick, flight: Path, outside: Path, tmp_path: Path) -> None:
    """Each address answers at once, nothing of others is among it, and SIGTERM ends the program."""
    trick(flight, outside)
    before, port = seen(outside), free_port()
    command = [sys.executable, "-m", "gcs_mosaic", "serve", str(flight), "--http", f"127.0.0.1:{port}"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        try:
            answers = [answer_of(f"http://127.0.0.1:{port}/{path}", process) for path in ASKED]
            start = time.monotonic()
            process.send_signal(signal.SIGTERM)
            said = process.communicate(timeout=20)[0]
        finally:
            process.kill()
    assert time.monotonic() - start < 15, "it ends when it is asked to"
    assert not any(SECRET.encode() in data for _, data in answers)
    assert answers == [] or all(code in (0, 200, 204, 304, 400, 404, 409, 503) for code, _ in answers), list(
        zip(ASKED, answers, strict=True)
    )
    assert "Traceback" not in said
    assert seen(outside) == before


def described(url: str, status: int, answer: Any) -> tuple[int, bytes]:
    data: bytes = answer.read()
    told = data if "/api/" in url else None  # documents are answered as the stranger has left them
    assert faults_at(url, status, answer.headers.get_content_type(), told) == []
    return status, data


def answer_of(url: str, process: subprocess.Popen[str]) -> tuple[int, bytes]:
    """Code and content; 0 once the program has refused the folder."""
    until = time.monotonic() + 40
    while process.poll() is None:
        try:
            with urllib.request.urlopen(url, timeout=15) as answer:
                return described(url, answer.status, answer)
        except urllib.error.HTTPError as error:
            with error:
                return described(url, error.code, error)
        except urllib.error.URLError:
            assert time.monotonic() < until, "it does not begin to serve"
            time.sleep(0.2)
    return 0, b""
