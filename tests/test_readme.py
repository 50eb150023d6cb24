"""What README.md and its further pages show is true: commands run, examples run, options, files and settings exist."""

import argparse
import os
import re
import shlex
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NoReturn
from urllib.request import urlopen

import pytest

import gcs_mosaic.cli.main
import sitl.__main__
import sitl.flight
from sitl.path import Plan
from tests import fresh
from tests.running import until
from tests.settings import load_config
from tests.sure import sure

README, ARCHITECTURE, FIGURES = "README.md", "gcs_mosaic/README.md", "tests/benchmarks/README.md"
PAGES = {
    name: (fresh.ROOT / name).read_text(encoding="utf-8")
    for name in (README, ARCHITECTURE, "config/README.md", "sitl/README.md", FIGURES)
}
MOST_LINES, LONGEST_LINE = 150, 130  # of README.md: an operator reads it standing
ALL = "\n".join(PAGES.values())
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
BLOCKS = BLOCK.findall(ALL)
LINES = [
    line for kind, text in BLOCKS if kind == "sh" for line in text.splitlines() if shlex.split(line, comments=True)
]
SET_UP = [line for line in LINES if line.startswith("python3 -m venv .venv && ")]
ACTIVATE = ". .venv/bin/activate"
INLINE = re.findall(r"`((?:gcs-mosaic|python -m sitl) [^`]+)`", ALL)
USAGE = [line for line in LINES if line not in (*SET_UP, ACTIVATE)] + INLINE
EXAMPLES = [text for kind, text in BLOCKS if kind == "python"]
SETTINGS = [text for kind, text in BLOCKS if kind == "yaml"] + re.findall(r"`(\w+: \{[^`]+\})`", ALL)
PROGRAMS = {("gcs-mosaic",): gcs_mosaic.cli.main.main, ("python", "-m", "sitl"): sitl.__main__.main}
FLIGHT_S, ENDING_S, OTHERS_S = 480, 200, 120


def test_the_operators_page_is_short() -> None:
    lines = PAGES[README].splitlines()
    assert len(lines) <= MOST_LINES
    assert [line for line in lines if len(line) > LONGEST_LINE] == []


def test_every_block_is_of_a_kind_that_is_tested_here() -> None:
    """Commands, examples and settings are; text shows what programs print."""
    assert {kind for kind, _ in BLOCKS} <= {"sh", "python", "yaml", "text"}


@pytest.mark.parametrize("page", PAGES)
def test_what_it_links_to_exists(page: str) -> None:
    assert [link for link in links(page) if not leads_somewhere(page, link)] == []


def test_links_that_lead_nowhere_are_found() -> None:
    assert leads_somewhere(ARCHITECTURE, "../README.md#start")
    assert not leads_somewhere(ARCHITECTURE, "../README.md#no-such-heading")
    assert not leads_somewhere(ARCHITECTURE, "no_such_file.py")


def test_the_first_page_leads_to_all_others() -> None:
    assert PAGES.keys() - {README} <= {link.partition("#")[0] for link in links(README)}


def test_every_picture_is_shown_somewhere() -> None:
    shown = {(fresh.ROOT / page).parent.joinpath(link).resolve() for page in PAGES for link in links(page)}
    assert set((fresh.ROOT / ".readme").iterdir()) <= shown


def test_rooms_and_files_are_called_as_they_are() -> None:
    """Bold names without a capital or a space, in the page of the architecture."""
    named = re.findall(r"\*\*([a-z_/]+)\*\*", PAGES[ARCHITECTURE])
    files = [path.with_suffix("") for path in (fresh.ROOT / "gcs_mosaic").rglob("*") if path.suffix in ("", ".py")]
    assert named
    assert [name for name in named if not any(f"/{path}".endswith(f"/{name}") for path in files)] == []


def test_the_benchmarks_exist() -> None:
    listed = re.findall(r"^\* `(\w+)", PAGES[FIGURES], flags=re.MULTILINE)
    named = re.findall(r"python -m tests\.benchmarks\.([a-z]\w*)", ALL)
    assert listed
    assert named
    assert [name for name in listed + named if not (fresh.ROOT / f"tests/benchmarks/{name}.py").exists()] == []


@pytest.mark.parametrize("settings", SETTINGS)
def test_settings_are_settings(settings: str, tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text(settings, encoding="utf-8")
    load_config(file)


def test_two_commands_set_up_one_flies_and_one_tests() -> None:
    fly, test = SET_UP
    assert fly.endswith("/gcs-mosaic demo --stay")
    assert test.endswith("/pytest")
    as_for_tests = fly.replace("-e .", '--quiet -e ".[dev]"').replace("gcs-mosaic demo --stay", "pytest")
    assert as_for_tests == test, (
        "what is tried with each change would not try what the first command does before it flies"
    )
    assert all(line in PAGES[README].splitlines() for line in SET_UP)


def test_the_second_command_is_what_judges_changes() -> None:
    """This very test is part of what that command runs."""
    assert SET_UP[1] in fresh.run(".ci/run", "--show").splitlines()


@pytest.mark.thorough
@pytest.mark.long
def test_the_first_command_flies_and_shows_the_map(tmp_path: Path) -> None:
    fresh.need_packages(tmp_path)
    need_port(8470)
    flies_and_shows_the_map(SET_UP[0], fresh.clone(tmp_path / "gcs-mosaic"), tmp_path / "said")


def flies_and_shows_the_map(line: str, folder: Path, said: Path) -> None:
    """A line that flies a demo and stays: all frames are placed, the page answers, and Ctrl-C ends it in order."""
    with typed(line, folder, said) as (process, said):
        page = wait_for(r"the page stays at (http://\S+)", process, said)
        until(lambda: answers(page), "the page is served")
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(ENDING_S) == 0, said.read_text()
    placed, frames = sure(re.search(r"against the truth: placed (\d+)/(\d+) ", said.read_text())).groups()
    assert placed == frames


@pytest.mark.long
@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_runs(example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, world_cache: Path) -> None:
    flight = sitl.flight.make("survey", tmp_path, (480, 360), cache=world_cache, route=Plan(frames=4))
    (tmp_path / flight.names[0]).parent.rename(tmp_path / "frames")
    monkeypatch.chdir(tmp_path)
    with redirect_stdout(StringIO()) as said:
        exec(compile(example, "an example", "exec"), {})
    assert all(said.getvalue().count(Path(name).name) >= 2 for name in flight.names)  # once added, once placed


def test_the_options_of_all_commands_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", only_take_apart)
    assert [line for line in USAGE if not understood(line)] == []
    assert understood(".venv/bin/gcs-mosaic --mavlink udp:14550 --out somewhere  # with a comment")
    assert not understood("gcs-mosaic --no-such-option")


def links(page: str) -> list[str]:
    """To files of this project."""
    found = re.findall(r"\]\(([^)]+)\)", BLOCK.sub("", PAGES[page]))
    return [link for link in found if "://" not in link]


def leads_somewhere(page: str, link: str) -> bool:
    path, _, heading = link.partition("#")
    target = (fresh.ROOT / page).parent / path if path else fresh.ROOT / page
    return target.exists() and (not heading or heading in headings(target))


def headings(page: Path) -> set[str]:
    """As links name them: GitHub's rule."""
    titles = re.findall(r"^#+ (.+)$", BLOCK.sub("", page.read_text(encoding="utf-8")), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


TAKE_APART = argparse.ArgumentParser.parse_args


class Understood(Exception):  # noqa: N818 - no error
    """A program has taken its arguments apart; it is stopped before it does anything."""


def only_take_apart(parser: argparse.ArgumentParser, words: list[str]) -> NoReturn:
    raise Understood(TAKE_APART(parser, words))


def understood(line: str) -> bool:
    words = tuple(shlex.split(line.replace(".venv/bin/", "").replace("NAME", "survey"), comments=True))
    start = next((start for start in PROGRAMS if words[: len(start)] == start), None)
    assert start, f"no test knows this program: {line}"
    try:
        PROGRAMS[start](words[len(start) :])
    except Understood:
        return True
    return False


def answers(page: str) -> bool:
    """On a busy machine the page's process may be ready after the flight, which does not wait for it."""
    try:
        with urlopen(page, timeout=20) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


@contextmanager
def typed(line: str, folder: Path, said: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A line as typed in a terminal: Ctrl-C reaches all that it starts."""
    shell = ["env", "--default-signal", "bash", "-c", line]
    with said.open("wb") as file:
        process = subprocess.Popen(
            shell,
            cwd=folder,
            env=fresh.environment(),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
        )
    try:
        yield process, said
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(ENDING_S)


def wait_for(pattern: str, process: subprocess.Popen[bytes], said: Path) -> str:
    deadline = time.monotonic() + FLIGHT_S
    while not (found := re.search(pattern, said.read_text())):
        assert process.poll() is None, said.read_text()
        assert time.monotonic() < deadline, said.read_text()
        time.sleep(0.5)
    return found[1]


def need_port(port: int) -> None:
    """Wait for another flight on this machine to end; skip the test if it does not."""
    deadline = time.monotonic() + OTHERS_S
    while is_taken(port):
        if time.monotonic() > deadline:
            pytest.skip(f"another program has port {port}, where the page of the README's flight is to be")
        time.sleep(1)


def is_taken(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_each_sentence_on_security_has_its_test() -> None:
    section = PAGES[ARCHITECTURE].partition("\n## Security\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+) \| (.+) \|$", section, flags=re.MULTILINE)[1:]
    named = [re.fullmatch(r"`([\w/]+\.py)::(test_\w+)`", held_by) for _, held_by in rows]
    assert len(named) > 15
    for row, found in zip(rows, named, strict=True):
        assert found, row
        assert f"\ndef {found[2]}(" in (fresh.ROOT / "tests" / found[1]).read_text(encoding="utf-8"), row
