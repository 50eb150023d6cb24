"""The page's scripts as one file; and what somebody sees if that does not come."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.app import VIEWER
from gcs_mosaic.web.bundle import bundle
from gcs_mosaic.web.server import WebServer
from tests.tiers import thorough
from tests.web.browser import CHROMIUM, open_browser
from tests.web.seen_flight import seen_flight

# Those that the page, a browser or somebody's language loads by itself.
BY_THEMSELVES = {"start", "sw", "words.de"}


def test_every_script_is_in_it_once_and_after_what_it_imports() -> None:
    names = re.findall(r"^modules\.(\w+) = ", bundle(VIEWER), re.MULTILINE)
    assert sorted(names) == sorted({path.stem for path in VIEWER.glob("*.js")} - BY_THEMSELVES)
    for at, name in enumerate(names):
        imports = re.findall(r'^import .* from "/viewer/(\w+)\.js"', (VIEWER / f"{name}.js").read_text(), re.MULTILINE)
        assert set(imports) <= set(names[:at]), name


@pytest.mark.parametrize(
    "line", ['import * as one from "/viewer/one.js";', 'import one from "/viewer/one.js";', "export default 3;"]
)
def test_another_manner_of_writing_is_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / "viewer.js").write_text(f"{line}\n")
    with pytest.raises(ValueError, match=re.escape(line)):
        bundle(tmp_path)


def test_scripts_that_import_each_other_are_refused(tmp_path: Path) -> None:
    (tmp_path / "viewer.js").write_text('import { one } from "/viewer/one.js";\n')
    (tmp_path / "one.js").write_text('import { other } from "/viewer/viewer.js";\nexport const one = 1;\n')
    with pytest.raises(ValueError, match="import each other: viewer, one"):
        bundle(tmp_path)


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize(("lost", "language"), [("page.js", "en"), ("leaflet.js", "en"), thorough("page.js", "de")])
def test_a_script_that_is_lost_on_the_way_leaves_a_sentence_and_a_way_on(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, lost: str, language: str
) -> None:
    server = WebServer(seen_flight(tmp_path).root, HttpAddress("127.0.0.1", 0))
    url = server.start()
    with open_browser(tmp_path_factory.mktemp("profile"), [f"--lang={language}"]) as page:
        page.command("Emulation.setUserAgentOverride", userAgent="test", acceptLanguage=language)
        page.command("Network.setBlockedURLs", urls=[f"*/{lost}*"])
        page.open(url)
        said = {"en": "The page could not be loaded whole.", "de": "Die Seite konnte nicht ganz geladen werden."}
        page.wait_for(f"document.getElementById('failed')?.innerText.startsWith('{said[language]}')")
        page.command("Network.setBlockedURLs", urls=[])
        page.evaluate("document.querySelector('#failed button').click()")
        page.wait_for("document.querySelectorAll('.leaflet-tile-loaded').length > 0")
        assert page.evaluate("document.getElementById('failed') === null")
    server.stop()
