"""Where a team's map lies, and its tiles alone: as the operator's page asks for them."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.geo.mercator import MOST_LATITUDE_DEG
from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.web import access
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.maps import underlay
from gcs_mosaic.web.maps.underlay import underlay_of
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access
from tests.sure import sure
from tests.web.maps.anchored_flight import AnchoredFlight, picture_of
from tests.web.maps.test_underlay import Put, folder, mbtiles, plain, png
from tests.web.test_notes_api import Writer

FINEST = [Tile(7, x, y) for x, y in ((68, 45), (70, 46), (69, 48))]
TILES = {tile: png(plain(10, 200, 30)) for tile in (*FINEST, Tile(5, 17, 11), Tile(4, 8, 5))}
# Of columns 68 to 70 and rows 45 to 48 of 128.
WEST, EAST = 360 * 68 / 128 - 180, 360 * 71 / 128 - 180
NORTH, SOUTH = (float(np.degrees(2 * np.arctan(np.exp(np.pi * (1 - 2 * y / 128))) - np.pi / 2)) for y in (45, 49))
COVERED = (WEST, SOUTH, EAST, NORTH)
TOKEN = "abcdefgh23456789"
ENDLESS = (
    "CREATE VIEW tiles AS WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n) "
    "SELECT -i AS zoom_level, i AS tile_column, i AS tile_row, zeroblob(9) AS tile_data FROM n WHERE i < 0"
)


def telling(path: Path, bounds: object) -> Path:
    """The same file, which says so of itself."""
    file = sqlite3.connect(path)
    file.execute("CREATE TABLE metadata (name TEXT, value)")
    file.execute("INSERT INTO metadata VALUES ('bounds', ?)", (bounds,))
    file.commit()
    file.close()
    return path


@pytest.mark.parametrize("put", [mbtiles, folder])
def test_levels_and_bounds_are_those_of_its_tiles(tmp_path: Path, put: Put) -> None:
    found = sure(sure(underlay_of(str(put(tmp_path, TILES)))).extent)
    assert (found.minzoom, found.maxzoom) == (4, 7)
    assert found.bounds == pytest.approx(COVERED, abs=1e-9)


@pytest.mark.parametrize("put", [mbtiles, folder])
def test_a_map_of_the_world_ends_where_the_world_ends(tmp_path: Path, put: Put) -> None:
    found = sure(sure(underlay_of(str(put(tmp_path, {Tile(0, 0, 0): png(plain(1, 2, 3))})))).extent)
    assert found.bounds == pytest.approx((-180, -MOST_LATITUDE_DEG, 180, MOST_LATITUDE_DEG))


@pytest.mark.parametrize(
    ("told", "bounds"),
    [
        ("12.5,42.0,18.0,46.5", (12.5, 42.0, 18.0, 46.5)),
        ("-180,-85,180,85", COVERED),
        ("-1e999,42.0,15.0,90", (WEST, 42.0, 15.0, NORTH)),
        ("100,-20,110,-10", COVERED),
        ("18,46.5,12.5,42", COVERED),
        ("nan,42,18,46", COVERED),
        ("12.5,42.0,18.0", COVERED),
        ("somewhere", COVERED),
        ("1," * 100_000, COVERED),
        (b"\xff\x00", COVERED),
        (17, COVERED),
    ],
)
def test_what_the_file_says_of_itself_narrows_them_where_that_can_be(
    tmp_path: Path, told: object, bounds: tuple[float, ...]
) -> None:
    found = sure(sure(underlay_of(str(telling(mbtiles(tmp_path, TILES), told)))).extent)
    assert found.bounds == pytest.approx(bounds, abs=1e-9)


def test_of_tiles_that_no_map_has_nothing_is_told(tmp_path: Path) -> None:
    path = tmp_path / "odd.mbtiles"
    file = sqlite3.connect(path)
    file.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
    odd: list[tuple[object, ...]] = [(9, -1, 5), (9, 512, 5), (9, "x", 5), (9, 3.5, 5), (9, None, None), (99, 1, 1)]
    file.executemany("INSERT INTO tiles VALUES (?, ?, ?, zeroblob(9))", odd)
    file.commit()
    file.close()
    assert sure(underlay_of(str(path))).extent is None


def test_a_file_that_would_count_for_ever_has_none_soon(tmp_path: Path) -> None:
    path = tmp_path / "endless.mbtiles"
    file = sqlite3.connect(path)
    file.execute(ENDLESS)
    file.close()
    start = time.monotonic()
    assert sure(underlay_of(str(path))).extent is None
    assert time.monotonic() - start < 2


def test_names_that_are_no_tiles_are_passed_over(tmp_path: Path) -> None:
    base = folder(tmp_path, TILES)
    for name in ("27/1/1.png", "007/1/1.png", "8/x/1.png", "8/300/1.png", "6/-1/0.png", "7/68/46.txt", "7/68/999.png"):
        path = base / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    (base / "9").write_text("a file")
    found = sure(sure(underlay_of(str(base))).extent)
    assert (found.minzoom, found.maxzoom) == (4, 7)
    assert found.bounds == pytest.approx(COVERED, abs=1e-9)
    empty = tmp_path / "empty"
    empty.mkdir()
    assert sure(underlay_of(str(empty))).extent is None


def test_a_folder_without_end_is_looked_at_in_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underlay, "MOST_NAMES", 20)
    column = tmp_path / "base" / "20" / "7"
    column.mkdir(parents=True)
    for row in range(50):
        (column / f"{row}.png").touch()
    assert len(underlay.numbers_in(column, underlay.SUFFIXES)) == 20
    assert sure(sure(underlay_of(str(tmp_path / "base"))).extent).maxzoom == 20


def test_a_large_map_is_looked_at_by_its_index(tmp_path: Path) -> None:
    """Half a million tiles in a table and a view, as tools write them."""
    path = mbtiles(tmp_path, {})
    file = sqlite3.connect(path)
    file.execute(
        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < 524287) "
        "INSERT INTO map SELECT 12, 1000 + i / 512, 2000 + i % 512, 'sea' FROM n"
    )
    file.execute("INSERT INTO images VALUES ('sea', zeroblob(9))")
    file.commit()
    file.close()
    start = time.monotonic()
    found = sure(sure(underlay_of(str(path))).extent)
    assert time.monotonic() - start < 2
    south, north = (float(np.degrees(np.arctan(np.sinh(np.pi * (2 * row / 4096 - 1))))) for row in (2000, 2512))
    assert found.bounds == pytest.approx((360 * 1000 / 4096 - 180, south, 360 * 2024 / 4096 - 180, north), abs=1e-9)


@pytest.fixture
def over(flight: AnchoredFlight, tmp_path: Path) -> Iterator[Writer]:
    """A server with that map, which others reach by a token."""
    settings = WebSettings(underlay=str(mbtiles(tmp_path, TILES)))
    server = WebServer(flight.root, HttpAddress("0.0.0.0", 0), Feed(), access=Access(token=TOKEN), settings=settings)
    yield Writer(server.start())
    server.stop()


def test_the_page_is_told_where_the_map_lies(over: Writer) -> None:
    told = over.get("/maps")["underlay"]
    assert (told["minzoom"], told["maxzoom"]) == (4, 7)
    assert told["bounds"] == pytest.approx(COVERED, abs=1e-9)


def test_its_tiles_are_served_alone(over: Writer) -> None:
    tile = FINEST[0]
    answer, data = over.ask(f"/api/v1/underlay/{tile.z}/{tile.x}/{tile.y}")
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert picture_of(data)[100, 100].tolist() == pytest.approx([10, 200, 30, 255], abs=3)
    etag = {"If-None-Match": answer.headers["ETag"]}
    assert over.status(f"/api/v1/underlay/{tile.z}/{tile.x}/{tile.y}", **etag) == 304
    x, y = 2 * tile.x, 2 * tile.y
    assert picture_of(over.ask(f"/api/v1/underlay/8/{x}/{y}")[1])[9, 9].tolist() == pytest.approx(
        [10, 200, 30, 255], abs=3
    )  # enlarged
    answer, data = over.ask("/api/v1/underlay/7/0/0")
    assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png")
    assert picture_of(data)[..., 3].max() == 0
    assert [over.status(f"/api/v1/underlay/{path}") for path in ("3/8/0", "27/0/0", "0/0/1", "3/1/x")] == [404] * 4


def test_they_are_shown_to_those_who_may_look(over: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "is_loopback", lambda origin: False)
    tile = ancestor(FINEST[0], 5)
    path = f"/api/v1/underlay/{tile.z}/{tile.x}/{tile.y}"
    assert over.status(path) == 401
    assert over.status(f"{path}?token={TOKEN}") == 401  # which opens what is under /maps/ alone
    assert over.status(path, Authorization=f"Bearer {TOKEN}") == 200


def test_without_such_a_map_there_is_none(client: Writer) -> None:
    assert client.get("/maps")["underlay"] is None
    answer, said = client.ask("/api/v1/underlay/0/0/0")
    assert (answer.status, said.decode()) == (404, "The settings name no map: web: {underlay: FILE}.\n")


def test_a_map_that_cannot_be_placed_is_said_so(flight: AnchoredFlight, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed(), settings=WebSettings(underlay=str(empty)))
    told = Writer(server.start()).get("/maps")
    server.stop()
    assert told["underlay"] is None
    assert told["over_underlay"] is not None
