"""Pages of another site in a real browser, with Leaflet, OpenLayers and MapLibre, show the living map as our own page does."""

from __future__ import annotations

import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import AnyImage
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.app import VIEWER
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, picture_of
from tests.web.test_notes_api import Writer
from tests.web.test_scripts import INSTALL_S, OUT_OF_REACH, npm

PAGES = Path(__file__).parent / "libraries"
HERE = (128.0, 128.0)  # the middle of the tile that is painted
RED = np.full((256, 256, 4), (0, 0, 255, 255), np.uint8)
CHANGED_S = 5.0
SIZE = 400
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(500),
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
]


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages, with Leaflet as the program has it, and the others from npm where that is within reach."""
    folder = tmp_path_factory.mktemp("libraries")
    for path in PAGES.iterdir():
        shutil.copy2(path, folder)
    shutil.copytree(VIEWER / "vendor" / "leaflet", folder / "leaflet")
    if shutil.which("npm"):
        command = [*npm(), "install", "--no-fund", "--no-audit", "--ignore-scripts"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=INSTALL_S, check=False)
        assert done.returncode == 0 or any(one in done.stderr for one in OUT_OF_REACH), done.stderr
    return folder


@pytest.fixture(scope="module")
def other_site(libraries: Path) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=str(libraries)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with open_browser(tmp_path_factory.mktemp("profile"), SOFTWARE_GL) as opened:
        opened.resize(SIZE, SIZE)
        yield opened


def middle_of(page: Page, folder: Path) -> AnyImage:
    """The colour (blue, green, red) in the middle of what is seen."""
    page.screenshot(folder / "seen.png")
    return picture_of((folder / "seen.png").read_bytes())[SIZE // 2, SIZE // 2, :3]


@pytest.mark.parametrize("library", ["leaflet", "openlayers", "maplibre"])
def test_a_tile_that_is_painted_is_seen_within_seconds(
    flight: AnchoredFlight, feed: Feed, libraries: Path, other_site: str, page: Page, library: str, tmp_path: Path
) -> None:
    if library != "leaflet" and not (libraries / "node_modules").exists():
        pytest.skip("npm's packages are out of reach")
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), feed, settings=WebSettings(cors=True))
    own = server.start()
    flight.set_pins(Writer(own))
    longitude, latitude = flight.truth.places(np.array(HERE)).tolist()
    told = quote(f"{own}maps/{FLIGHT}/tilejson.json", safe="")
    page.open(f"{other_site}{library}.html?tilejson={told}&longitude={longitude!r}&latitude={latitude!r}")
    truth = flight.colour_at(np.array(longitude), np.array(latitude))
    wait_for_colour(page, tmp_path, truth, 20.0)
    paint_red(flight, feed)
    taken = wait_for_colour(page, tmp_path, np.array([0.0, 0.0, 255.0]), CHANGED_S)
    assert taken < CHANGED_S
    assert page.complaints == []
    # And so it is on our own page.
    page.open(f"{own}")
    page.wait_for("[...document.querySelectorAll('.leaflet-tile-loaded img')].some((one) => one.naturalWidth)")
    page.screenshot(tmp_path / "own.png")
    shown = picture_of((tmp_path / "own.png").read_bytes()).astype(int)
    assert ((shown[..., 2] > 230) & (shown[..., :2].max(axis=2) < 40)).sum() > 300
    page.open("about:blank")
    server.stop()


def paint_red(flight: AnchoredFlight, feed: Feed) -> None:
    painted = Tile(16, 1 << 15, 1 << 15)
    flight.put(painted, RED)
    feed.publish(flight.small.write(), [(0, painted)])


def wait_for_colour(page: Page, folder: Path, wanted: AnyImage, patience_s: float) -> float:
    """Seconds until the middle has a colour."""
    start = time.monotonic()
    while np.abs(middle_of(page, folder).astype(float) - wanted).max() > 25:
        assert time.monotonic() - start < patience_s, (middle_of(page, folder), wanted, page.complaints)
        time.sleep(0.1)
    return time.monotonic() - start
