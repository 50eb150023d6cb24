"""The map that a team brings: MBTiles or a folder, under the flight's; missing tiles, and files that mean harm."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.stitch.arrays import AnyImage
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.maps.underlay import LARGEST_BYTES, underlay_of
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from tests.sure import sure
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, laid_at, picture_of
from tests.web.maps.test_wms import gmap_box
from tests.web.test_notes_api import Writer

Put = Callable[[Path, dict[Tile, bytes]], Path]
TILE = Tile(5, 17, 11)


def png(image: AnyImage) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def plain(*colour: int, side: int = 256) -> AnyImage:
    return np.full((side, side, 3), colour, np.uint8)


def mbtiles(root: Path, tiles: dict[Tile, bytes]) -> Path:
    path = root / "base map.mbtiles"
    file = sqlite3.connect(path)
    file.execute("CREATE TABLE map (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_id TEXT)")
    file.execute("CREATE TABLE images (tile_id TEXT, tile_data BLOB)")
    file.execute(
        "CREATE VIEW tiles AS SELECT zoom_level, tile_column, tile_row, tile_data FROM map JOIN images USING (tile_id)"
    )
    file.execute("CREATE UNIQUE INDEX places ON map (zoom_level, tile_column, tile_row)")
    file.execute("CREATE UNIQUE INDEX ids ON images (tile_id)")
    for tile, data in tiles.items():
        file.execute("INSERT INTO map VALUES (?, ?, ?, ?)", (tile.z, tile.x, (1 << tile.z) - 1 - tile.y, str(tile)))
        file.execute("INSERT INTO images VALUES (?, ?)", (str(tile), data))
    file.commit()
    file.close()
    return path


def folder(root: Path, tiles: dict[Tile, bytes]) -> Path:
    for tile, data in tiles.items():
        suffix = ".png" if data.startswith(b"\x89PNG") else ".jpg"
        path = root / "base" / str(tile.z) / str(tile.x) / f"{tile.y}{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return root / "base"


@pytest.fixture(params=[mbtiles, folder])
def put(request: pytest.FixtureRequest) -> Put:
    made: Put = request.param
    return made


def test_a_tile_is_read_and_a_missing_one_is_made_of_its_ancestor(tmp_path: Path, put: Put) -> None:
    ramp = np.tile(np.arange(256, dtype=np.uint8)[None, :, None], (256, 1, 3))
    other = ancestor(TILE, 3)
    jpeg = bytes(cv2.imencode(".jpg", plain(10, 200, 30))[1])
    underlay = sure(underlay_of(str(put(tmp_path, {TILE: jpeg, other: png(ramp)}))))
    assert sure(underlay.tile(*TILE))[9, 9].tolist() == pytest.approx([10, 200, 30, 255], abs=4)
    child = TILE.children[3]
    assert sure(underlay.tile(*child))[9, 9].tolist() == pytest.approx([10, 200, 30, 255], abs=4)
    beside = Tile(5, TILE.x + 1, TILE.y)
    enlarged = sure(underlay.tile(*beside))
    left = 256 * (beside.x % 4) / 4
    assert enlarged[100, :, 0].astype(float) == pytest.approx(left + (np.arange(256) + 0.5) / 4 - 0.5, abs=1.0)
    assert underlay.tile(5, 0, 0) is None
    assert underlay.tile(20, 0, 0) is None


def test_tiles_of_other_kinds_are_shown_too(tmp_path: Path) -> None:
    tiles = {
        Tile(3, 0, 0): png(plain(9, 99, 199, side=512)),
        Tile(3, 1, 0): png(np.full((256, 256), 77, np.uint8)),
        Tile(3, 2, 0): png(np.dstack([plain(1, 2, 3), np.full((256, 256), 255, np.uint8)])),
        Tile(3, 3, 0): png(np.full((256, 256, 3), 77 << 8, np.uint16)),
    }
    underlay = sure(underlay_of(str(mbtiles(tmp_path, tiles))))
    shown = [sure(underlay.tile(*tile))[50, 50].tolist() for tile in tiles]
    assert shown == [[9, 99, 199, 255], [77, 77, 77, 255], [1, 2, 3, 255], [77, 77, 77, 255]]


def test_what_is_no_picture_or_too_large_is_missing(tmp_path: Path, put: Put) -> None:
    huge = png(np.zeros((5000, 5000, 3), np.uint8))
    forged = bytearray(png(plain(1, 2, 3)))
    forged[16:24] = (60000).to_bytes(4, "big") * 2
    tiles = {
        Tile(2, 0, 0): b"\x89PNG nothing",
        Tile(2, 1, 0): huge,
        Tile(2, 2, 0): bytes(forged),
        Tile(2, 3, 0): png(plain(1, 2, 3)) + b"\0" * LARGEST_BYTES,
        Tile(2, 0, 1): b"\x89PNG",
        Tile(2, 1, 1): png(plain(1, 2, 3))[:60],
    }
    underlay = sure(underlay_of(str(put(tmp_path, tiles))))
    assert [tile for tile in tiles if underlay.tile(*tile) is not None] == []


def test_a_file_that_would_count_for_ever_is_given_up(tmp_path: Path) -> None:
    path = tmp_path / "endless.mbtiles"
    file = sqlite3.connect(path)
    file.execute(
        "CREATE VIEW tiles AS WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n) "
        "SELECT -i AS zoom_level, i AS tile_column, i AS tile_row, zeroblob(9) AS tile_data FROM n WHERE i < 0"
    )
    file.commit()
    file.close()
    start = time.monotonic()
    try:
        underlay = underlay_of(str(path))
    except UsageError:
        underlay = None
    if underlay is not None:
        assert underlay.tile(3, 1, 1) is None
    assert time.monotonic() - start < 2


@pytest.mark.parametrize("written", [None, b"", b"no database", b"SQLite format 3\0" + b"\0" * 100])
def test_what_is_no_map_is_refused_at_the_start_in_one_sentence(tmp_path: Path, written: bytes | None) -> None:
    path = tmp_path / "x.mbtiles"
    if written is not None:
        path.write_bytes(written)
    with pytest.raises(UsageError, match=r"name an MBTiles file of PNG or JPEG tiles, or a folder z/x/y\.png") as error:
        WebServer(tmp_path, HttpAddress("127.0.0.1", 0), settings=WebSettings(underlay=str(path))).start()
    assert "\n" not in str(error.value)


@pytest.mark.long
def test_the_flight_lies_over_it_where_a_program_asks_for_that(tmp_path: Path, flight: AnchoredFlight) -> None:
    level = flight.laid.levels[1]
    column, row = laid_at(flight.laid, level, -600.0, -450.0)
    base = mbtiles(tmp_path, {ancestor(Tile(level, column, row), level - 2): png(plain(10, 200, 30))})
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed(), settings=WebSettings(underlay=str(base)))
    client = Writer(server.start())
    flight.set_pins(client)
    path = f"/maps/{FLIGHT}/{level}/{column}/{row}.png"
    alone = picture_of(client.ask(path)[1])
    both = picture_of(client.ask(f"{path}?underlay=1")[1])
    empty, full = alone[..., 3] == 0, alone[..., 3] == 255
    assert empty.any()
    assert full.any()
    assert (both[..., :3][empty] == [10, 200, 30]).all()
    assert (both[..., :3][full] == alone[..., :3][full]).all()
    assert both[..., 3].min() == 255
    query = f"VERSION=1.1.1&REQUEST=GetMap&SERVICE=WMS&styles=&bbox={gmap_box(level, column, row)}"
    query += "&width=256&height=256&srs=EPSG:4326&format=image/png&underlay=1"
    assert (picture_of(client.ask(f"/maps/{FLIGHT}/wms?{query}")[1]) == both).all()
    assert b"underlay=1" in client.ask(f"/maps/{FLIGHT}/tilejson.json?underlay=1")[1]
    assert client.get("/maps")["over_underlay"]["xyz"].endswith("/{z}/{x}/{y}.png?underlay=1")
    server.stop()
