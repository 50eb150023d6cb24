"""What tests of the page share: a browser, a small flight and its server, a feed of changes, a certificate for HTTPS on
loopback."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.web import app
from gcs_mosaic.web.feed import Feed
from tests.web.browser import Page, open_browser
from tests.web.seen_flight import seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A laptop's."""
    with open_browser(tmp_path_factory.mktemp("profile")) as opened:
        opened.resize(1280, 800)
        yield opened


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    return seen_flight(tmp_path)


@pytest.fixture
def url(flight: SmallFlight, page: Page) -> Iterator[str]:
    """Of the flight's page, which is left before its server ends."""
    with served(flight.root) as address:
        yield address
        page.open("about:blank")


@pytest.fixture
def feed() -> Feed:
    return Feed()


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A PEM file with a certificate of 127.0.0.1, signed by itself, and its key."""
    program = shutil.which("openssl")
    if program is None:
        pytest.skip("openssl makes the certificate")
    folder = tmp_path_factory.mktemp("certificate")
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 30 -subj /CN=test"
    names = ["-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(
        [program, *words.split(), *names, "-keyout", "key.pem", "-out", "cert.pem"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    both = folder / "both.pem"
    both.write_text((folder / "cert.pem").read_text() + (folder / "key.pem").read_text())
    return both


@pytest.fixture(autouse=True)
def short_farewell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages on this machine read the end of a flight at once."""
    monkeypatch.setattr(app, "FAREWELL_S", 0.2)


@pytest.fixture(scope="session", autouse=True)
def judged_servers(complaints: list[str]) -> None:
    """Also those that a module shares."""


@pytest.fixture(autouse=True)
def judged_answers(every_answer_is_as_described: None) -> None:
    """Also to what a browser asks."""
