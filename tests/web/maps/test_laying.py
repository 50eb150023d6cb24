"""An island is laid on a team's base map by dragging its corners, in a real browser; the anchor that results is the true one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.geo.mercator import (
    ground_scale,
    mercator,
    places_of_mercator,
    resolution_m,
    tile_corner,
)
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from tests.running import until
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.maps.anchored_flight import BOX, AnchoredFlight, picture_of
from tests.web.maps.test_underlay import mbtiles, png
from tests.web.test_notes_api import Writer
from tests.web.test_people_on_the_page import AXE, VIOLATIONS, Person

LEVELS = (17, 18)
CORNERS = np.array([[BOX[0], BOX[1]], [BOX[2], BOX[1]], [BOX[2], BOX[3]], [BOX[0], BOX[3]]])
HANDLES = "[...document.querySelectorAll('.handle')]"
pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]


def base_map(flight: AnchoredFlight, root: Path) -> Path:
    """The true ground, a good way around the flight."""
    tiles: dict[Tile, bytes] = {}
    for level in LEVELS:
        side = resolution_m(level) * TILE_SIZE
        spots = mercator(flight.truth.places(CORNERS)) - tile_corner(level, 0, 0)
        low, high = (spots * [1, -1]).min(axis=0) / side - 1, (spots * [1, -1]).max(axis=0) / side + 1
        for x in range(math.floor(low[0]), math.ceil(high[0])):
            for y in range(math.floor(low[1]), math.ceil(high[1])):
                tiles[Tile(level, x, y)] = png(painted(flight, level, x, y))
    return mbtiles(root, tiles)


def painted(flight: AnchoredFlight, level: int, x: int, y: int) -> Any:
    steps = (np.arange(TILE_SIZE) + 0.5) * resolution_m(level)
    west, north = tile_corner(level, x, y)
    places = places_of_mercator(np.stack(np.meshgrid(west + steps, north - steps), axis=-1))
    return np.rint(flight.colour_at(places[..., 0], places[..., 1])).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Table:
    """The dialog at which a person lays the island."""

    page: Page
    flight: AnchoredFlight

    @property
    def metres_per_px(self) -> float:
        """On the ground."""
        west, east = self._view()[0]
        return float(east - west) / self._box()[2] * ground_scale(self.flight.truth.plane.latitude_deg)

    def pixel_of(self, places: Array) -> Array:
        """Where on the page places on earth (n, 2) are shown."""
        (west, east), (south, north) = self._view()
        left, top, width, height = self._box()
        spots = mercator(places)
        across, down = (spots[:, 0] - west) / (east - west), (north - spots[:, 1]) / (north - south)
        return np.stack([left + across * width, top + down * height], axis=-1)

    def handles(self) -> Array:
        middle = "(({ x, y, width, height }) => [x + width / 2, y + height / 2])"
        return np.array(self.page.evaluate(f"{HANDLES}.map((one) => {middle}(one.getBoundingClientRect()))"))

    def drag(self, corner: int, onto: Array) -> None:
        """By the mouse."""
        start = np.round(self.handles()[corner])
        self._mouse("mousePressed", start)
        for share in (0.2, 0.7, 1.0):
            self._mouse("mouseMoved", np.round(start + share * (onto - start)))
        self._mouse("mouseReleased", np.round(onto))

    def key(self, corner: int, name: str, *, shift: bool = False) -> None:
        self.page.evaluate(f"{HANDLES}[{corner}].focus()")
        for kind in ("rawKeyDown", "keyUp"):
            self.page.command("Input.dispatchKeyEvent", type=kind, key=name, code=name, modifiers=8 * shift)

    def open(self) -> None:
        self.page.evaluate("document.getElementById('laying-open').click()")
        self.page.wait_for(f"{HANDLES}.length === 4")
        tiles = "[...document.querySelectorAll('#laying .leaflet-tile')]"
        self.page.wait_for(f"{tiles}.length > 5 && {tiles}.every((one) => one.matches('.leaflet-tile-loaded'))")

    def can_be_taken(self) -> bool:
        return not self.page.evaluate("document.getElementById('laying-take').disabled")

    def take(self, sigma: float = 10, said: str | None = None) -> None:
        """`said`: why it is not taken."""
        self.page.evaluate(f"document.getElementById('laying-form').elements.sigma.value = {sigma}")
        self.page.evaluate("document.getElementById('laying-take').click()")
        refused = f"document.getElementById('laying-said').innerText.includes('{said}')"
        self.page.wait_for("!document.getElementById('laying').open" if said is None else refused)

    def unlike(self, folder: Path) -> float:
        """Grey levels between picture and base map, about the middle of what the handles enclose."""
        shown = []
        for share in (0, 1):
            self.opaque(share)
            shown.append(self.shot(folder / f"{share}.png"))
        self.opaque(0.5)
        x, y = np.round(self.handles().mean(axis=0)).astype(int)
        part = np.s_[y - 20 : y + 20, x - 20 : x + 20]
        return float(np.abs(shown[0][part] - shown[1][part]).mean())

    def opaque(self, share: float) -> None:
        slider = "document.getElementById('laying-form').elements.opacity"
        self.page.evaluate(f"{slider}.value = {share}; {slider}.dispatchEvent(new Event('input'))")

    def shot(self, path: Path) -> Array:
        """The page's pixels, blue first."""
        self.page.screenshot(path)
        return picture_of(path.read_bytes())[..., :3].astype(float)

    def _mouse(self, kind: str, at: Array) -> None:
        self.page.command(
            "Input.dispatchMouseEvent",
            type=kind,
            x=float(at[0]),
            y=float(at[1]),
            button="left",
            buttons=1,
            clickCount=1,
        )

    def _view(self) -> Array:
        """Metres of the map: west and east, south and north."""
        told = self.page.evaluate("document.getElementById('laying-map').dataset.bounds")
        places = np.array([float(one) for one in told.split(",")]).reshape(2, 2)
        return mercator(places).T

    def _box(self) -> list[float]:
        box = "(({ x, y, width, height }) => [x, y, width, height])"
        return list(self.page.evaluate(f"{box}(document.getElementById('laying-map').getBoundingClientRect())"))


@pytest.fixture
def laid(flight: AnchoredFlight, tmp_path: Path) -> Iterator[tuple[Table, Writer]]:
    """The dialog is open, over a base map; the flight has no anchor."""
    whole = Camera(1300, 1000)  # a frame that covers the box
    flight.small.estimates = [replace(one, camera=whole) for one in flight.small.estimates]
    flight.small.write()
    settings = WebSettings(underlay=str(base_map(flight, tmp_path)))
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed(), settings=settings)
    url = server.start()
    with open_browser(tmp_path / "profile") as page:
        someone = Person(page, url)
        someone.press("open-anchors")
        page.wait_for("!document.getElementById('laying-open').hidden")
        table = Table(page, flight)
        table.open()
        yield table, Writer(url)
        page.open("about:blank")
        assert page.complaints == []
    server.stop()


def test_corners_dragged_onto_a_base_map_lay_the_island_to_a_pixel(laid: tuple[Table, Writer], tmp_path: Path) -> None:
    table, client = laid
    page, truth = table.page, table.flight.truth
    places = truth.places(CORNERS)
    onto = table.pixel_of(places)
    start, pixel_m = table.handles(), table.metres_per_px
    assert not table.can_be_taken()
    table.drag(0, onto[0])
    assert table.handles() - start == pytest.approx(np.tile(onto[0] - start[0], (4, 1)), abs=1.5)  # it moves along
    assert not table.can_be_taken()
    assert table.unlike(tmp_path) > 30
    table.drag(2, onto[2] + (12, 1))
    assert table.can_be_taken()
    table.key(2, "ArrowLeft", shift=True)
    for name in ("ArrowLeft", "ArrowLeft", "ArrowUp"):
        table.key(2, name)
    assert table.handles() == pytest.approx(onto, abs=1.5)
    until(lambda: table.unlike(tmp_path) < 6, "the picture looks like the ground that it lies on")
    page.evaluate(AXE.read_text("utf-8") + "; true")
    assert page.evaluate(VIOLATIONS.replace("run(document", "run('#laying'")) == []  # what is behind it is inert
    table.take()
    told = client.get("/anchors")
    assert [(pin["label"], pin["sigma_m"]) for pin in told["pins"]] == [("corner 1", 10), ("corner 3", 10)]
    assert all(pin["follows"] and pin["frame"] for pin in told["pins"])  # wherever their frames are moved to
    assert metres_off(client, places) < pixel_m < 1
    lay_again(table, client, places)


def lay_again(table: Table, client: Writer, places: Array) -> None:
    """It begins where it lies by now; what is dragged now holds instead of what was dragged before."""
    table.open()
    until(lambda: np.abs(table.handles() - table.pixel_of(places)).max() < 2, "it begins where it lies")
    assert table.page.evaluate("document.querySelectorAll('.handle.set').length") == 0
    pixel_m = table.metres_per_px
    for corner in (1, 3, 0):
        table.drag(corner, table.handles()[corner] + (40, -20))
    for corner in (1, 3, 0):
        table.drag(corner, table.pixel_of(places)[corner])
    assert "3 corners are set; the worst lies 0." in table.page.evaluate(
        "document.getElementById('laying-told').innerText"
    )
    table.take(sigma=500, said="or say that they are more exact")
    table.take()
    assert [pin["label"] for pin in client.get("/anchors")["pins"]] == ["corner 1", "corner 2", "corner 4"]
    assert client.get("/anchors")["islands"][0]["fits"]
    assert metres_off(client, places) < pixel_m


def metres_off(client: Writer, places: Array) -> float:
    """How far the worst corner is laid from its true place."""
    found = [client.get(f"/coordinates?island=0&x={x}&y={y}")["place"] for x, y in CORNERS]
    laid = np.array([[one["longitude"], one["latitude"]] for one in found])
    spots = mercator(laid) - mercator(places)
    return float(np.linalg.norm(spots, axis=1).max() * ground_scale(places[0, 1]))
